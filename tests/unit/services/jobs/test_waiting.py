"""The sentence of a job that is not over agrees with itself, also where the robots are ahead of the row that was read."""

from types import SimpleNamespace

import pytest

from api_schemas.job import JobState
from services.jobs.claim import Claim
from services.jobs.fleet import Fleet
from services.jobs.position import Ahead
from services.jobs.waiting import job_waits
from tests.unit.services.jobs.test_fleet import beat

NOW_S = 100.0
COUNTS = {"trials": 12, "trials_done": 0, "trials_active": 0}
ROW = SimpleNamespace(job_id="jmine", owner="ann", state=JobState.QUEUED, cancel_requested=False, robot=None, **COUNTS)


@pytest.fixture
def fleet():
    fleet = Fleet()
    for robot in ("robot-0", "robot-1"):
        fleet.token_changed(robot, present=True, now_s=NOW_S)
        fleet.heard(beat(robot=robot), NOW_S)
    return fleet


def said(fleet):
    return job_waits(ROW, Ahead(0), fleet, NOW_S)


def test_a_job_whose_robots_are_idle_is_about_to_be_leased(fleet):
    assert said(fleet) == "12 trials about to be leased: robot-0 is idle, robot-1 is idle"


def test_a_trial_that_a_robot_has_begun_since_is_running(fleet):
    fleet.leased(Claim("jmine-001", 1, "robot-0"), NOW_S)
    assert said(fleet) == "1 trial running, 11 more wait for a robot"


def test_a_trial_of_another_job_is_not(fleet):
    fleet.leased(Claim("jtheirs-001", 1, "robot-0"), NOW_S)
    assert said(fleet) == ("12 trials about to be leased: robot-0 is running a trial of another job, robot-1 is idle")


def test_of_many_robots_the_sentence_names_the_first(fleet):
    for number in range(2, 30):
        fleet.heard(beat(robot=f"robot-{number}"), NOW_S)
    assert said(fleet).endswith("robot-14 is idle, robot-15 is idle, and 22 more")
