"""Memory that was freed goes back to the system, also after large blocks have come and gone."""

import subprocess
import sys

import pytest

BLOCKS = """
import ctypes, sys
from pathlib import Path
from services.__main__ import return_freed_memory

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

libc = ctypes.CDLL(None)
libc.malloc.restype, libc.malloc.argtypes, libc.free.argtypes = ctypes.c_void_p, [ctypes.c_size_t], [ctypes.c_void_p]
if sys.argv[1] == "told":
    return_freed_memory()
libc.free(libc.malloc(30_000_000))  # glibc now takes less than this from its heap, and keeps twice as much of it
blocks = (ctypes.c_void_p * 200)()  # a list would grow among the blocks, and keep all below it where it ends
before = resident()
for i in range(200):
    blocks[i] = libc.malloc(100_000)
    ctypes.memset(blocks[i], 1, 100_000)
for block in blocks:
    libc.free(block)
print(resident() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="of glibc")
def test_freed_blocks_are_given_back():
    kept = {}
    for how in ("told", "untold"):
        done = subprocess.run([sys.executable, "-c", BLOCKS, how], check=True, capture_output=True, text=True, timeout=120)
        kept[how] = int(done.stdout)
    assert kept["told"] < 1e6, kept
    assert kept["untold"] > 10e6, "so that this test can fail"
