"""A child in the foreground gets its time to end, and nothing of it is left afterwards."""

import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from client_cli.terminal.errors import Interrupted
from client_cli.terminal.foreground import run_to_end

TIDIES_UP = """
import signal, sys, time
from pathlib import Path
folder = Path(sys.argv[1])
try:
    (folder / "begun").touch()
    time.sleep(60)
except KeyboardInterrupt:
    time.sleep(1)
    (folder / "tidy").touch()
"""


def stopped(folder: Path, number: signal.Signals, ends_within_s: float) -> float:
    """Stop a child that takes a second to tidy up, by a signal to us; how long its end took, in seconds."""
    told_s = []

    def stop():
        while not (folder / "begun").exists():
            time.sleep(0.02)
        told_s.append(time.monotonic())
        os.kill(os.getpid(), number)

    stopper = threading.Thread(target=stop)
    stopper.start()
    with pytest.raises(Interrupted, match="it was stopped"):
        run_to_end([sys.executable, "-c", TIDIES_UP, str(folder)], "it was stopped", ends_within_s=ends_within_s)
    stopper.join()
    return time.monotonic() - told_s[0]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_child_that_needs_time_to_end_gets_it(tmp_path, number):
    before = signal.getsignal(signal.SIGTERM)
    stopped(tmp_path, number, ends_within_s=30.0)
    assert (tmp_path / "tidy").exists()
    assert signal.getsignal(signal.SIGTERM) is before


def test_one_that_takes_longer_is_killed(tmp_path):
    assert stopped(tmp_path, signal.SIGINT, ends_within_s=0.1) < 1.0
    assert not (tmp_path / "tidy").exists()
