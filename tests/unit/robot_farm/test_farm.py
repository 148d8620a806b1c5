"""Whoever looks after several robots starts those anew that end, each with its own token."""

import pytest

from robot_farm import farm
from robot_farm.settings import TOKEN_VARIABLE, parse


@pytest.fixture
def settings(tmp_path, monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, "token")
    return parse(["--api", "http://127.0.0.1:1", "--data", str(tmp_path), "--robots", "1"])


def test_a_robot_whose_token_the_farm_has_forgotten_is_started_with_one_that_it_knows(settings, monkeypatch):
    known, shown = ["first", "second", "third"], []

    class Refused:
        """A process that ends at once, since the farm does not take it."""

        pid, returncode = 1, 1

        def __init__(self, _command, env):
            shown.append(env[TOKEN_VARIABLE])

        def poll(self):
            return self.returncode

    monkeypatch.setattr(farm, "own_token", lambda *_, **__: known[len(shown)])
    monkeypatch.setattr(farm.subprocess, "Popen", Refused)
    monkeypatch.setattr(farm, "RESTART_PAUSE_S", (0.0,))
    place = farm._Place("robot-0")
    for _ in known:
        farm._look_after(place, settings, [], lambda _: None)
    assert shown == known
