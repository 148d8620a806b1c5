"""Whoever looks after several robots starts those anew that end, each with its own token."""

import socket
from itertools import pairwise
from types import SimpleNamespace

import pytest

from robot_farm import farm
from robot_farm.forks import Forked
from robot_farm.link.api_link import ApiUnreachableError, NotAdmittedError
from robot_farm.settings import NOT_TAKEN, TOKEN_VARIABLE, parse
from robot_farm.warm_parent import Word


@pytest.fixture
def settings(tmp_path, monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, "token")
    return parse(["--api", "http://127.0.0.1:1", "--data", str(tmp_path), "--robots", "1"])


def ended(name, token, returncode):
    """A robot that came, got its word, and has ended."""
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with its:
        its.send(b"1")
        robot = Forked(ours, Word(name, ("--robot", name), token))
        robot.meet()
        assert Word.unpack(its.recv(1 << 16)).token == token
    robot.returncode = returncode
    return robot


def test_a_robot_whose_token_the_farm_has_forgotten_is_started_with_one_that_it_knows(settings, monkeypatch):
    known, shown = ["first", "second", "third"], []

    def refused(name, token):
        shown.append(token)
        return ended(name, token, NOT_TAKEN)

    monkeypatch.setattr(farm, "own_token", lambda *_, **__: known[len(shown)])
    monkeypatch.setattr(farm, "REFUSED_AGAIN_S", 0.0)
    monkeypatch.setattr(farm, "RESTART_PAUSE_S", (0.0,))
    place = farm._Place("robot-0")
    for _ in known:
        farm._look_after(place, settings, refused, lambda _: None)
    assert shown == known


@pytest.mark.parametrize(
    ("returncode", "pauses_s"), [(NOT_TAKEN, (0.2, 60.0, 60.0)), (1, (0.2, 1.0, 5.0)), (-9, (0.2, 1.0, 5.0))]
)
def test_a_robot_that_the_farm_does_not_take_is_started_again_once_and_then_rarely(returncode, pauses_s, settings, monkeypatch):
    now_s, starts_s, said = [1000.0], [], []

    def start(name, token):
        starts_s.append(now_s[0])
        return ended(name, token, returncode)

    monkeypatch.setattr(farm, "own_token", lambda *_, **__: "token")
    monkeypatch.setattr(farm, "time", SimpleNamespace(monotonic=lambda: now_s[0]))  # of farm alone: other threads wait by it
    place = farm._Place("robot-0")
    while len(starts_s) < 4:
        farm._look_after(place, settings, start, said.append)
        now_s[0] += 0.05
    assert [later - earlier for earlier, later in pairwise(starts_s)] == pytest.approx(pauses_s, abs=0.15)
    assert len(said) == 3


@pytest.mark.parametrize(
    ("refusal", "again_s"),
    [
        (NotAdmittedError("the token's scope is submit"), farm.REFUSED_AGAIN_S),
        (ApiUnreachableError("no answer"), farm.JOIN_AGAIN_S),
    ],
)
def test_whoever_was_refused_does_not_ask_every_second(refusal, again_s, settings, monkeypatch):
    asked, said = [], []

    def own_token(*_, **__):
        asked.append(farm.time.monotonic())
        raise refusal

    monkeypatch.setattr(farm, "own_token", own_token)
    place = farm._Place("robot-0")
    for _ in range(3):
        farm._look_after(place, settings, ended, said.append)
    assert len(asked) == len(said) == 1
    assert str(refusal) in said[0]
    assert place.start_at_s - asked[0] == pytest.approx(again_s, abs=0.5)
    assert place.process is None
