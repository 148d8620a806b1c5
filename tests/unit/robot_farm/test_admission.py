"""How a robot comes into the farm: what it waits for, and what ends it."""

import threading

import httpx
import pytest

from robot_farm import admission
from robot_farm.admission import asked_until_answered
from robot_farm.api_link import ApiLink, ApiUnreachableError, NotAdmittedError, NotExpectedError


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
