"""Logs wait for a file store that is away as long as their lease lives; what else is wrong with them does not wait so long."""

import pytest

from api_schemas.trial import Fault, Outcome, OutcomeKind
from robot_farm.link import api_link
from tests.unit.robot_farm.link.lease_api import serving, wait_until


def recorded_at_once(monkeypatch):
    """Every trial is recorded at once; who has no patience gives up soon."""

    def run(_lease, _policy, _driver, _channels, log, **_):
        log.write_bytes(b"a log")
        return Outcome(kind=OutcomeKind.RECORDED, fault=Fault.NONE, reason="recorded")

    monkeypatch.setattr("robot_farm.robot.run_trial", run)
    monkeypatch.setattr(api_link, "RETRY_FOR_S", 0.5)


@pytest.fixture(autouse=True)
def recorded(monkeypatch):
    recorded_at_once(monkeypatch)


def tries(api):
    return len(api.times("/log"))


def test_a_log_waits_while_its_lease_lives(api, robot):
    api.of_files = 503
    with serving(robot, api):
        wait_until(lambda: tries(api) >= 6)
        api.of_files = 200
    assert api.times("/log")[-1] - api.times("/log")[0] > 5 * api_link.RETRY_FOR_S
    assert [each["outcome"]["kind"] for each in api.outcomes] == ["recorded"]
    assert len(api.outcomes[0]["log_sha256"]) == 64


@pytest.mark.parametrize(("status", "of_files"), [(200, 500), (503, 503)])
def test_it_does_not_wait_for_an_api_that_fails_or_that_does_not_renew(api, robot, status, of_files):
    api.status, api.of_files = status, of_files
    with serving(robot, api) as thread:
        thread.join(120)
        assert not thread.is_alive()
    assert not api.outcomes


def test_nor_for_ever(api, robot, monkeypatch):
    monkeypatch.setattr(api_link, "WAIT_FOR_S", 1.0)
    api.of_files = 503
    with serving(robot, api):
        pass
    assert api_link.RETRY_FOR_S < api.times("/log")[-1] - api.times("/log")[0] < 200.0, "usually it waits for an hour"
    assert not api.outcomes


def test_who_cancels_meanwhile_need_not_wait(api, robot):
    api.of_files = 503
    with serving(robot, api):
        wait_until(lambda: tries(api) >= 4)
        robot._cancel("j1-000", 1)
    (outcome,) = api.outcomes
    assert (outcome["outcome"]["kind"], outcome["log_sha256"]) == ("cancelled", None)
