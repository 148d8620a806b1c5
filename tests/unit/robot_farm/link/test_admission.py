"""How a robot comes into the farm and stays: what it waits for, what ends it, and when it asks for its next certificate."""

import threading
import time

import httpx
import pytest

from robot_farm.link import admission
from robot_farm.link.admission import asked_until_answered, renewed
from robot_farm.link.api_link import ApiLink, ApiUnreachableError, NotAdmittedError, NotExpectedError
from robot_farm.link.bus_access import Access, clock_s


def asking(*answers):
    """What gives or raises one after the other."""
    left = iter(answers)

    def ask():
        answer = next(left)
        if isinstance(answer, Exception):
            raise answer
        return answer

    return ask


def test_a_robot_that_is_not_expected_waits_and_asks_again_slowly(monkeypatch):
    waited, said = [], []
    monkeypatch.setattr(stop := threading.Event(), "wait", waited.append)
    ask = asking(NotExpectedError("robot-100"), ApiUnreachableError("away"), NotExpectedError("robot-100"), "welcome")
    assert asked_until_answered(ask, stop, said.append) == "welcome"
    assert waited == [admission.NOT_EXPECTED_AGAIN_S, admission.JOIN_AGAIN_S, admission.NOT_EXPECTED_AGAIN_S]
    assert admission.NOT_EXPECTED_AGAIN_S >= 30
    assert "robot-100" in said[0]


def test_one_whose_token_is_refused_does_not_wait():
    with pytest.raises(NotAdmittedError):
        asked_until_answered(asking(NotAdmittedError("revoked")), threading.Event(), print)


@pytest.mark.parametrize(("problem", "error"), [("robot-not-expected", NotExpectedError), ("scope-missing", NotAdmittedError)])
def test_the_farms_refusal_says_which_it_is(problem, error):
    link = ApiLink("http://farm", "token")
    answer = httpx.Response(403, json={"type": f"/problems/{problem}"})
    link._client = httpx.Client(base_url="http://farm", transport=httpx.MockTransport(lambda _: answer))
    with link, pytest.raises(NotAdmittedError) as refused:
        link.once("POST", "/v1/robots/robot-100/bus")
    assert refused.type is error


def test_the_time_that_the_machine_slept_counts_for_a_certificate(monkeypatch):
    class Bus:
        def renew(self, access):
            self.access = access

    old, new, bus = Access((), "farm", renew_at_s=clock_s() + 3600.0), Access((), "farm"), Bus()
    assert renewed(old, lambda: new, bus, print) is old
    read, slept_s = time.clock_gettime, {time.CLOCK_BOOTTIME: 7200.0}
    monkeypatch.setattr(time, "clock_gettime", lambda clock: read(clock) + slept_s.get(clock, 0.0))
    assert renewed(old, lambda: new, bus, print) is new
    assert bus.access is new
