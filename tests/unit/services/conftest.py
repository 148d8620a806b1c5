"""A database in its newest form on each home, and a fleet of idle robots."""

import pytest

from api_schemas.bus import Heartbeat
from api_schemas.robot import RobotState
from services.database.database import Database, migrate
from services.jobs import lease
from services.jobs.fleet import Fleet


@pytest.fixture(params=["sqlite", "postgres"])
async def new_database(request, tmp_path):
    if request.param == "postgres":
        url = await request.getfixturevalue("postgres").cleared()
    else:
        url = f"sqlite+aiosqlite:///{tmp_path / 'farm.sqlite'}"
        await migrate(url)
    opened = Database(url)
    yield opened
    await opened.close()


def beat(robot, state=RobotState.IDLE, reason=None):
    return Heartbeat(robot=robot, instance="one", pid=1, host="h", state=state, reason=reason)


async def leased_to(tx, now_s, queued, robot, *, departure, lease_s):
    """One lease as a dispatcher writes it: the claim, or None where it cannot be."""
    leases = lease.Leases(tx, now_s, lease_s)
    claim = await leases.write(queued, robot, departure)
    await leases.finish()
    if claim is not None:
        await lease.end_turn(tx, now_s, queued.owner)
    return claim


@pytest.fixture
def fleet_of():
    def make(*robots, now_s=1000.0):
        fleet = Fleet()
        for robot in robots:
            fleet.token_changed(robot, present=True, now_s=now_s)
            fleet.heard(beat(robot), now_s)
        return fleet

    return make
