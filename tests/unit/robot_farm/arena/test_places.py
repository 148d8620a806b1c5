"""Robots that look for free numbers take the first, and give them back however their process ends."""

import subprocess
import sys
from dataclasses import replace

import pytest

from robot_farm.arena import places
from robot_farm.arena.places import held_names
from robot_farm.settings import TOKEN_VARIABLE, parse


@pytest.fixture
def settings(tmp_path, monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, "token")
    return parse(["--api", "http://127.0.0.1:1", "--data", str(tmp_path), "--robots", "2", "--first", "free"])


def test_each_process_takes_the_first_that_are_free(settings):
    with held_names(settings) as first:
        with held_names(settings) as second:
            assert (first, second) == (("robot-0", "robot-1"), ("robot-2", "robot-3"))
        with held_names(replace(settings, robots=1)) as again:
            assert again == ("robot-2",)
    with held_names(settings) as all_free:
        assert all_free == first


def test_a_killed_process_gives_its_number_back(settings):
    holding = f"""
import fcntl, os, time
fcntl.flock(os.open({str(settings.robots_folder / "robot-0.place")!r}, os.O_RDWR | os.O_CREAT), fcntl.LOCK_EX)
print("held", flush=True)
time.sleep(60)
"""
    settings.robots_folder.mkdir()
    with subprocess.Popen([sys.executable, "-c", holding], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "held\n"
        with held_names(settings) as names:
            assert names == ("robot-1", "robot-2")
        other.kill()
        other.wait()
    with held_names(settings) as names:
        assert names == ("robot-0", "robot-1")


def test_more_than_there_are_is_an_error(settings, monkeypatch):
    monkeypatch.setattr(places, "MOST_NUMBERS", 1)
    with pytest.raises(ValueError, match="only 1 of 2 robots are free"), held_names(settings):
        pass


def test_numbers_from_one_on_are_as_told(settings):
    with held_names(replace(settings, first=7)) as names:
        assert names == ("robot-7", "robot-8")
