"""A process that was told to stop ends, also when a part of it does not."""

import subprocess
import sys

HANGS = """
import asyncio, os, signal, threading, time
from services import router

router.END_WITHIN_S = 0.2

async def work():
    asyncio.get_running_loop().call_later(0.05, os.kill, os.getpid(), signal.SIGTERM)
    said = await router.told_to_stop()
    router.end_in_time()
    return said

def a_part_that_does_not_end():
    time.sleep(600)

print(asyncio.run(work()), flush=True)
a_part_that_does_not_end()
"""


def test_what_does_not_end_when_told_to_is_ended_and_says_where_it_stood():
    ended = subprocess.run([sys.executable, "-c", HANGS], capture_output=True, text=True, timeout=120, check=False)
    assert (ended.stdout, ended.returncode) == ("told to\n", 1)
    assert "a_part_that_does_not_end" in ended.stderr
