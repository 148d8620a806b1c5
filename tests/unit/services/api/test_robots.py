"""Only a robot that is not there can be forgotten."""

from types import SimpleNamespace

import pytest

from services.api.robots import forget_robot
from services.errors import Conflict
from services.jobs import robots
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals
from tests.unit.services.conftest import beat


async def test_a_robot_that_is_there_is_not_forgotten(new_database, fleet_of):
    clock = FarmClock.start()
    fleet = fleet_of("a", now_s=clock.now_s())
    farm = SimpleNamespace(fleet=fleet, clock=clock, database=new_database, signals=Signals())
    async with new_database.write() as tx:
        await robots.keep(tx, [beat("a")], clock.now_s())
    with pytest.raises(Conflict, match="a is there"):
        await forget_robot("a", None, farm)
    fleet.token_changed("a", present=False, now_s=clock.now_s())
    await forget_robot("a", None, farm)
    assert not fleet.members
    async with new_database.read() as connection:
        await robots.refresh(connection, fleet)
    assert not fleet.members
