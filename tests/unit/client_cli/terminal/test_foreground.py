"""A child in the foreground gets its time to end, and nothing of it is left afterwards."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from client_cli.terminal.errors import Interrupted
from client_cli.terminal.foreground import run_to_end
from tests.processes import lives, wait_until_gone

TIDIES_UP = """
import signal, sys, time
from pathlib import Path
folder, takes_s = Path(sys.argv[1]), float(sys.argv[2])
try:
    (folder / "begun").touch()
    time.sleep(600)
except KeyboardInterrupt:
    time.sleep(takes_s)
    (folder / "tidy").touch()
"""


def stopped(folder: Path, number: signal.Signals, *, takes_s: float, ends_within_s: float) -> None:
    """Stop a child that takes so long to tidy up, by a signal to us, and wait for its end."""

    def stop():
        while not (folder / "begun").exists():
            time.sleep(0.02)
        os.kill(os.getpid(), number)

    stopper = threading.Thread(target=stop)
    stopper.start()
    with pytest.raises(Interrupted, match="it was stopped"):
        run_to_end([sys.executable, "-c", TIDIES_UP, str(folder), str(takes_s)], "it was stopped", ends_within_s=ends_within_s)
    stopper.join()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_child_that_needs_time_to_end_gets_it(tmp_path, number):
    before = signal.getsignal(signal.SIGTERM)
    stopped(tmp_path, number, takes_s=0.3, ends_within_s=120.0)
    assert (tmp_path / "tidy").exists()
    assert signal.getsignal(signal.SIGTERM) is before


def test_one_that_takes_longer_is_killed(tmp_path):
    stopped(tmp_path, signal.SIGINT, takes_s=200.0, ends_within_s=0.1)
    assert not (tmp_path / "tidy").exists()


SLEEPS = "import os, sys, time; print(os.getpid(), flush=True); time.sleep(600)"
STARTS = f"import sys; from client_cli.terminal.foreground import run_to_end; run_to_end([sys.executable, '-c', {SLEEPS!r}], '')"


def test_a_child_does_not_outlive_us_who_were_killed():
    with subprocess.Popen([sys.executable, "-c", STARTS], stdout=subprocess.PIPE, text=True) as ours:
        assert ours.stdout is not None
        child = int(ours.stdout.readline())
        assert lives(child)
        ours.kill()
        assert ours.stdout.read() == "", "the other end is closed once the child ends"
    wait_until_gone(child)
