"""Leases that lapse count for trial and robot, unless the robot lives and says that the API did not answer it."""

import pytest
from sqlalchemy import select

from api_schemas.excitation import IdentificationRequest
from api_schemas.robot import RobotState
from services.database.tables import attempt, job, robot, trial
from services.dispatcher import queue
from services.dispatcher.overdue import LeaseEnder
from services.jobs import robots
from services.jobs.completion import OUTAGES
from services.jobs.fleet import SILENT_AFTER_S
from services.jobs.robots import FAULTS_IN_A_ROW
from services.jobs.signals import Signals
from services.jobs.submission import Sender, identify
from services.settings import Settings
from tests.unit.services.conftest import beat
from tests.unit.services.jobs.test_pinning import NOW_S, take

ONE_TRIAL = IdentificationRequest(robot="b", excitations=("chirps",))


class Clock:
    at_s = NOW_S

    def now_s(self):
        return self.at_s


class Lapses:
    """An identification on robot b, whose lease lapses again and again."""

    def __init__(self, database, fleet, folder):
        self.database, self.fleet, self.clock = database, fleet, Clock()
        self.ender = LeaseEnder(Settings(data=folder), database, self.clock, fleet, Signals())

    def says(self, claim, instance="one"):
        """The robot's heartbeat, which names the attempt that was cut off."""
        said = {"instance": instance, "cut_off_trial_id": claim.trial_id, "cut_off_fence": claim.fence}
        self.fleet.heard(beat("b").model_copy(update=said), self.clock.at_s)

    async def lapse(self, *, cut_off=True):
        claim = await take(self.database, "b", self.fleet)
        if cut_off:
            self.says(claim)
        await self.ender.end(claim, "the lease of b was not renewed in time")
        return await self.counted()

    async def counted(self):
        """Faults of trial and robot, the job's state, and the newest reason."""
        async with self.database.read() as connection:
            faults = (await connection.execute(select(trial.c.faults))).scalar_one()
            in_a_row = (await connection.execute(select(robot.c.faults_in_a_row))).scalar_one()
            state = (await connection.execute(select(job.c.state))).scalar_one()
            reason = (await connection.execute(select(attempt.c.reason).order_by(attempt.c.fence.desc()))).scalars().first()
        return faults, in_a_row, state, reason


@pytest.fixture
async def lapses(new_database, fleet_of, tmp_path):
    async with new_database.write() as tx:
        await robots.keep(tx, [beat("b")], NOW_S)
        await identify(tx, NOW_S, ONE_TRIAL, Sender("ann"))
    return Lapses(new_database, fleet_of("b", now_s=NOW_S), tmp_path)


async def test_a_robot_that_the_api_did_not_answer_and_its_trial_are_not_blamed(lapses):
    for _ in range(FAULTS_IN_A_ROW + 1):
        counted = await lapses.lapse()
    reason = "the lease of b was not renewed in time, since the API did not answer it"
    assert counted == (0, 0, "running", reason)
    assert (await lapses.lapse(cut_off=False))[:2] == (1, 1)


async def test_a_lapse_that_nobody_explains_counts_up_to_the_end(lapses):
    for _ in range(FAULTS_IN_A_ROW):
        counted = await lapses.lapse(cut_off=False)
    assert counted == (5, 5, "failed", "the lease of b was not renewed in time")


async def test_a_trial_that_is_cut_off_again_and_again_ends_too(lapses):
    for _ in range(OUTAGES):
        assert (await lapses.lapse())[:3] == (0, 0, "running")
    for number in range(1, FAULTS_IN_A_ROW):
        assert (await lapses.lapse())[:3] == (number, number, "running")
    assert (await lapses.lapse())[:3] == (5, 5, "failed")


@pytest.mark.parametrize("how", ["killed", "silent", "another attempt", "another process, too"])
async def test_a_robot_that_died_counts_whatever_it_last_said(lapses, how):
    claim = await take(lapses.database, "b", lapses.fleet)
    lapses.says(claim)
    if how == "killed":
        lapses.fleet.token_changed("b", present=False, now_s=NOW_S)
    elif how == "silent":
        lapses.clock.at_s += SILENT_AFTER_S + 1
    elif how == "another attempt":
        lapses.fleet.heard(beat("b").model_copy(update={"cut_off_trial_id": claim.trial_id, "cut_off_fence": 7}), NOW_S)
    else:
        for instance in ("two", "one"):
            lapses.says(claim, instance)
    await lapses.ender.end(claim, "the lease of b was not renewed in time")
    assert (await lapses.counted())[:2] == (1, 1)


@pytest.mark.parametrize("heard", ["nothing of it", "that it has it", "nothing at all"])
async def test_a_lease_that_was_never_offered_blames_nobody(lapses, heard):
    """The database restarts between the lease and its offer: the robot lives, was asked nothing and has done nothing wrong."""
    claim = await take(lapses.database, "b", lapses.fleet)
    async with lapses.database.read() as connection:
        (row,) = await queue.active(connection)
    lapses.clock.at_s = row.lease_until_s
    if heard != "nothing at all":
        named = {"trial_id": claim.trial_id, "fence": claim.fence} if heard == "that it has it" else {}
        lapses.fleet.heard(beat("b").model_copy(update=named), lapses.clock.at_s)
    never = lapses.ender.was_never_offered(row, lapses.clock.at_s)
    reason = lapses.ender.why_overdue(row, lapses.clock.at_s)
    await lapses.ender.end(claim, reason, never_offered=never)
    counted = await lapses.counted()
    assert never is (heard == "nothing of it")
    assert counted[:3] == ((0, 0, "running") if never else (1, 1, "running"))
    assert ("before they offered it" in counted[3]) is never


async def test_a_robot_that_waits_for_the_api_is_not_gone_for_good(fleet_of):
    member = fleet_of("b", now_s=NOW_S).member("b")
    member.heartbeat = beat("b", RobotState.OUT_OF_SERVICE, "a joint is stuck")
    assert member.is_gone(NOW_S)
    member.heartbeat = member.heartbeat.model_copy(update={"api_away": True, "reason": "the API does not answer"})
    assert member.state(NOW_S) == RobotState.OUT_OF_SERVICE and not member.is_gone(NOW_S)
    member.withdrawn = "five attempts failed on it"
    assert member.is_gone(NOW_S)
    member.withdrawn, member.lost_s = None, NOW_S
    assert member.is_gone(NOW_S)
