"""That nothing outlives the run: a process asks the kernel to be killed when its parent ends."""

import ctypes
import signal
import sys

PR_SET_PDEATHSIG = 1
"""Linux prctl(2): the signal to get when the parent ends."""


def end_with_parent() -> None:
    """Has this process killed when its parent ends, also if it is stopped then."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
