import asyncio

import pytest

from api_schemas.bus import CommandKind
from api_schemas.robot import OfferReply, RobotState
from services.dispatcher.commands import Commands
from services.dispatcher.steps import Steps
from services.jobs.clock import FarmClock
from services.jobs.signals import Signals
from tests.unit.services.conftest import beat


class Listener:
    """The bus as commands see it: robots that answer what they are told to."""

    def __init__(self):
        self.heard, self.accepts = [], True

    async def command(self, robot, command, timeout_s):
        self.heard.append((robot, command.kind))
        return OfferReply(accepted=True) if self.accepts else None


@pytest.fixture
def told(fleet_of):
    clock, bus = FarmClock.start(), Listener()
    fleet = fleet_of("a", now_s=clock.now_s())

    async def look(state):
        """What the robot hears when it shows this state; nothing is held back for having been said a moment ago."""
        steps = Steps(Signals())
        fleet.heard(beat("a", state), clock.now_s())
        Commands(bus, clock, fleet, steps, 1.0).tell_wishes()
        await steps.finish(5)
        await asyncio.sleep(0)
        heard, bus.heard = bus.heard, []
        return [kind for _, kind in heard]

    look.bus, look.member = bus, fleet.member("a")
    return look


async def test_a_robot_out_of_service_is_told_once_to_test_itself_again(told):
    told.member.test_wanted = True
    told.bus.accepts = False
    assert await told(RobotState.OUT_OF_SERVICE) == [CommandKind.RESUME]
    told.bus.accepts = True
    assert await told(RobotState.OUT_OF_SERVICE) == [CommandKind.RESUME]
    assert await told(RobotState.OUT_OF_SERVICE) == []


async def test_a_robot_is_told_to_drain_until_it_shows_that_it_heard(told):
    told.member.drain = True
    assert await told(RobotState.RUNNING) == [CommandKind.DRAIN]
    assert await told(RobotState.IDLE) == [CommandKind.DRAIN]
    assert await told(RobotState.DRAINING) == []


async def test_a_drained_robot_is_told_to_resume_until_it_shows_that_it_heard(told):
    assert await told(RobotState.DRAINING) == [CommandKind.RESUME]
    assert await told(RobotState.DRAINING) == [CommandKind.RESUME]
    assert await told(RobotState.IDLE) == []


async def test_a_robot_that_was_drained_and_resumed_within_one_trial_does_not_stay_drained(told):
    told.member.drain = True
    assert await told(RobotState.RUNNING) == [CommandKind.DRAIN]
    told.member.drain, told.member.test_wanted = False, True
    assert await told(RobotState.RUNNING) == []
    assert await told(RobotState.DRAINING) == [CommandKind.RESUME]


async def test_a_robot_that_nobody_resumes_stays_out_of_service(told):
    assert await told(RobotState.OUT_OF_SERVICE) == []
