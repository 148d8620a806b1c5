"""Whether processes that tests ended are gone."""

import time
from pathlib import Path

from tests.integration.farm_process import PATIENCE_S


def lives(pid: int) -> bool:
    """Whether a process is there and does not only wait to be reaped: in some containers nobody reaps orphans."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def wait_until_gone(*pids: int) -> None:
    """Wait until none of them lives."""
    give_up_s = time.monotonic() + PATIENCE_S
    while left := [pid for pid in pids if lives(pid)]:
        assert time.monotonic() < give_up_s, f"still there: {left}"
        time.sleep(0.02)
