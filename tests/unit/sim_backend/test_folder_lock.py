"""One sitting works in a folder at a time; a training that has lost its parent still holds it."""

import os
import subprocess
import sys

import pytest

from sim_backend.folder_lock import TakenError, taken


def test_a_second_sitting_is_told_who_has_the_folder(tmp_path):
    folder, said = tmp_path / "work", f"experiment small is under way in .*work: process {os.getpid()}, .*another --work"
    with taken(folder, "experiment small", "give another --work"):
        with pytest.raises(TakenError, match=said), taken(folder, "experiment small", "give another --work"):
            pass
        with taken(tmp_path / "other", "another experiment", ""):
            pass
    with taken(folder, "experiment small", "give another --work"):
        pass


def test_a_training_that_lost_its_parent_holds_the_folder_until_it_ends(tmp_path):
    text = f"""
import subprocess, sys
from pathlib import Path
from sim_backend.folder_lock import taken
with taken(Path({str(tmp_path)!r}), "an experiment", ""):
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=0, stdout=subprocess.DEVNULL, close_fds=False)
    print(child.pid, flush=True)
    import os, signal
    os.kill(os.getpid(), signal.SIGKILL)
"""
    parent = subprocess.Popen([sys.executable, "-c", text], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert parent.stdin is not None and parent.stdout is not None
    with parent.stdin, parent.stdout:
        parent.stdout.readline()
        parent.wait()
        with pytest.raises(TakenError, match="or one that it began"), taken(tmp_path, "an experiment", ""):
            pass
        parent.stdin.write(b"\n")
        parent.stdin.flush()
        told = []
        with taken(tmp_path, "an experiment", "", waits=told.append):
            pass
