"""Words on a full disk, in a process of their own: they are lost, and nobody ends by it."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.disk_steps import in_place, noted_steps
from trial_logs.disk import is_full, mb, put_in_place, room

SPEAKS = """
import sys
{begin}
for number in range(3):
    print("word", number, flush=True)
    sys.stderr.write("more words\\n")
sys.exit(7)
"""
LENIENT = "from trial_logs.disk import lose_words_rather_than_end; lose_words_rather_than_end()"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
@pytest.mark.parametrize(("begin", "code"), [("", 1), (LENIENT, 7)], ids=["as Python does", "lenient"])
def test_who_cannot_be_heard_goes_on(begin, code):
    with open("/dev/full", "wb") as full:  # noqa: PTH123
        said = SPEAKS.format(begin=begin)
        ended = subprocess.run([sys.executable, "-c", said], stdout=full, stderr=full, cwd=Path(__file__).parents[3], check=False)
    assert ended.returncode == code or (code == 1 and ended.returncode != 7)


def test_words_come_through_where_there_is_room(tmp_path):
    with (tmp_path / "log").open("wb") as log:
        said = SPEAKS.format(begin=LENIENT)
        subprocess.run([sys.executable, "-c", said], stdout=log, stderr=log, cwd=Path(__file__).parents[3], check=False)
    assert (tmp_path / "log").read_text().splitlines()[:2] == ["word 0", "more words"]


def test_a_full_disk_is_known_by_what_led_to_an_error():
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    wrapped = RuntimeError("could not be written")
    wrapped.__cause__ = full
    assert is_full(full) and is_full(wrapped)
    assert not is_full(OSError(errno.EACCES, "no")) and not is_full(None)


def test_room_is_of_the_file_system(tmp_path):
    found = room(tmp_path)
    assert 0 < found.free_bytes <= found.total_bytes
    assert (mb(2_540_000), mb(63_000_000)) == ("2.54 MB", "63 MB")


def test_a_new_file_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    fresh, path = tmp_path / "kept.new", tmp_path / "kept"
    path.write_text("old")
    fresh.write_text("new")
    steps = noted_steps(monkeypatch)
    put_in_place(fresh, path)
    assert steps == in_place("kept.new", path)
    assert (path.read_text(), fresh.exists()) == ("new", False)
