"""Two processes never serve one folder; whoever ended holds nothing."""

import os
import subprocess
import sys

import pytest

from services import folder_lock
from services.errors import NotReady
from services.folder_lock import LOCK, held_alone, is_held

HOLD = "import fcntl, sys; f = open(sys.argv[1], 'w'); fcntl.flock(f, fcntl.LOCK_EX); print('held', flush=True); sys.stdin.read()"


async def test_a_folder_is_held_until_it_is_left(tmp_path):
    assert not is_held(tmp_path / LOCK)
    async with held_alone(tmp_path):
        assert is_held(tmp_path / LOCK)
        assert (tmp_path / LOCK).read_text() == str(os.getpid())
    assert not is_held(tmp_path / LOCK)


@pytest.fixture
def other(tmp_path):
    """A process that holds the folder."""
    command = [sys.executable, "-c", HOLD, str(tmp_path / LOCK)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


async def test_another_processs_folder_is_waited_for_and_then_refused(tmp_path, monkeypatch, other):
    monkeypatch.setattr(folder_lock, "ENDS_WITHIN_S", 0.3)
    with pytest.raises(NotReady, match="another folder with --data"):
        async with held_alone(tmp_path):
            pass
    other.kill()
    other.wait()
    async with held_alone(tmp_path):
        assert is_held(tmp_path / LOCK)
