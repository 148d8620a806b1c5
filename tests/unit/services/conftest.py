"""A database in its newest form on each home, and a fleet of idle robots."""

import shutil

import pytest

from api_schemas.bus import Heartbeat
from api_schemas.robot import RobotState
from services.database.database import Database, migrate
from services.jobs import lease
from services.jobs.fleet import Fleet
from tests.homes import now


@pytest.fixture(scope="session")
def newest_sqlite(tmp_path_factory):
    """A file in the newest form, which tests copy: migrations take longer than most of them."""
    path = tmp_path_factory.mktemp("newest") / "farm.sqlite"
    now(migrate(f"sqlite+aiosqlite:///{path}"))
    assert [each.name for each in path.parent.iterdir()] == [path.name], "all of it is in the file"
    return path


@pytest.fixture
def sqlite_url(newest_sqlite, tmp_path):
    """The address of a new SQLite database in the newest form."""
    return f"sqlite+aiosqlite:///{shutil.copyfile(newest_sqlite, tmp_path / 'farm.sqlite')}"


@pytest.fixture(params=["sqlite", "postgres"])
async def new_database(request, sqlite_url):
    opened = Database(await request.getfixturevalue("postgres").cleared() if request.param == "postgres" else sqlite_url)
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
