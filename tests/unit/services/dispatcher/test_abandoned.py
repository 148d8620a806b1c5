"""Jobs whose one robot stays away fail after a time, and say why."""

from dataclasses import dataclass

import pytest
from sqlalchemy import insert, select

from api_schemas.excitation import IdentificationRequest
from api_schemas.robot import RobotState
from services.database.tables import job, robot, trial
from services.dispatcher.abandoned import Abandoner
from services.jobs.requeue import requeue
from services.jobs.signals import Signals
from services.jobs.submission import Sender, identify
from tests.unit.services.conftest import beat

NOW_S = 1000.0


@dataclass
class Clock:
    at_s: float = NOW_S

    def now_s(self):
        return self.at_s


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(robot).values(robot="b", drain=False, first_seen_at="now"))
    return new_database


@pytest.fixture
def waiting(database, fleet_of):
    """An identification that must run on robot b, and a look at it: (clock, fleet, look), which gives the job's row."""

    async def make(created_s=NOW_S):
        clock, fleet = Clock(), fleet_of("a", "b")
        abandoner = Abandoner(database, clock, fleet, Signals(), gone_s=60.0)
        async with database.write() as tx:
            await identify(tx, created_s, IdentificationRequest(robot="b", excitations=("chirps",)), Sender("ann"))

        async def look(at_s, state=RobotState.IDLE, reason=None):
            clock.at_s = NOW_S + at_s
            if state != RobotState.LOST:
                fleet.heard(beat("b", state, reason), clock.at_s)
            await abandoner.look()
            async with database.read() as connection:
                return (await connection.execute(select(job).order_by(job.c.number))).first()

        look.abandoner = abandoner
        return look

    return make


async def test_a_robot_that_stays_out_of_service_ends_the_job_with_its_reason(database, waiting):
    look = await waiting()
    out = (RobotState.OUT_OF_SERVICE, "joint 4 does not follow")
    for at_s in (10.0, 69.0):
        assert (await look(at_s, *out)).state == "queued"
    row = await look(70.0, *out)
    assert row.state == "failed"
    sentence = "1 of 1 trials could run on b alone, which is out of service (joint 4 does not follow) and was away for 60 s"
    assert row.reason == sentence
    async with database.read() as connection:
        assert (await connection.execute(select(trial.c.state))).scalars().all() == ["cancelled"]


async def test_a_lost_robot_counts_too_and_one_that_came_back_begins_anew(waiting):
    look = await waiting()
    assert (await look(0.0)).state == "queued"
    assert (await look(50.0, RobotState.LOST)).state == "queued"
    assert (await look(105.0)).state == "queued"
    assert (await look(130.0, RobotState.LOST)).state == "queued"
    assert (await look(180.0, RobotState.LOST)).state == "queued"
    assert (await look(190.0, RobotState.LOST)).state == "failed"


async def test_who_leads_again_knows_nothing_of_when_robots_were_gone(waiting):
    look = await waiting()
    assert (await look(0.0, RobotState.LOST)).state == "queued"
    look.abandoner.begin_anew()
    assert (await look(300.0, RobotState.LOST)).state == "queued"
    assert (await look(359.0, RobotState.LOST)).state == "queued"
    assert (await look(360.0, RobotState.LOST)).state == "failed"


async def test_a_job_for_a_robot_that_was_gone_before_waits_as_long(waiting):
    look = await waiting(created_s=NOW_S + 100)
    out = (RobotState.OUT_OF_SERVICE, "broken")
    assert (await look(0.0, *out)).state == "queued"
    assert (await look(159.0, *out)).state == "queued"
    assert (await look(160.0, *out)).state == "failed"


async def test_a_job_that_ended_or_still_runs_a_trial_is_left_alone(database, waiting):
    look = await waiting()
    async with database.write() as tx:
        await tx.execute(job.update().values(trials_active=1))
    out = (RobotState.OUT_OF_SERVICE, "broken")
    await look(0.0, *out)
    assert (await look(100.0, *out)).state == "queued"


async def test_a_job_that_was_queued_again_waits_as_long_though_another_waits_for_the_robot_all_the_time(database, waiting):
    look = await waiting()
    out = (RobotState.OUT_OF_SERVICE, "broken")
    await look(0.0, *out)
    async with database.write() as tx:
        await identify(tx, NOW_S + 50, IdentificationRequest(robot="b", excitations=("chirps",)), Sender("bob"))
    assert (await look(60.0, *out)).state == "failed"
    async with database.write() as tx:
        await requeue(tx, NOW_S + 70, 1)
    assert (await look(129.0, *out)).state == "queued"
    assert (await look(130.0, *out)).state == "failed"
