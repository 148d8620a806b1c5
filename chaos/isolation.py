"""Namespaces of our own for a run: network, mounts and processes, so that nothing of it reaches or outlives its machine."""

import ctypes
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ISOLATED = "TRIFARM_CHAOS_ISOLATED"
UNSHARE = ("--mount", "--net", "--pid", "--fork", "--kill-child", "--mount-proc")
MS_REC_PRIVATE = 0x4000 | 0x40000
"""Linux mount(2): what is mounted here is mounted nowhere else."""


@dataclass(frozen=True)
class Isolation:
    """What may be done to the machine; ``why_not`` says why namespaces are missing, None where they are there."""

    why_not: str | None

    @property
    def there(self) -> bool:
        """Whether this process is alone in its namespaces."""
        return self.why_not is None


def enter(arguments: list[str]) -> Isolation:
    """Starts this program anew in namespaces of its own and ends with it, or says why that cannot be."""
    if os.environ.get(ISOLATED) == "1":
        _settle()
        return Isolation(None)
    why_not = _why_not()
    if why_not is None:
        command = ["unshare", *UNSHARE, sys.executable, "-P", "-m", "chaos", "run", *arguments]
        os.execvpe("unshare", command, os.environ | {ISOLATED: "1"})  # noqa: S606
    return Isolation(why_not)


def mount_small_disk(folder: Path, size_bytes: int) -> None:
    """Makes the folder a disk of this size in memory; it goes with the last process of the run."""
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size_bytes},mode=755", "tmpfs", str(folder)], check=True)


def _why_not() -> str | None:
    if sys.platform != "linux":
        return f"namespaces are Linux's, and this is {sys.platform}"
    if os.geteuid() != 0:
        return "namespaces and disks of our own need root"
    for program in ("unshare", "nsenter", "ip", "mount"):
        if shutil.which(program) is None:
            return f"the program {program} is not installed"
    tried = subprocess.run(["unshare", *UNSHARE, "true"], capture_output=True, text=True, check=False)
    return None if tried.returncode == 0 else f"no namespaces can be made here: {tried.stderr.strip()}"


def _settle() -> None:
    # The first process of a namespace gets no signal that it has not asked for.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    libc = ctypes.CDLL(None, use_errno=True)
    libc.mount(b"none", b"/", None, MS_REC_PRIVATE, None)
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
