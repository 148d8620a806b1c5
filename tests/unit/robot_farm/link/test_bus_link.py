"""A robot that is out of service says so, declines, and hears when it is wanted back; on a real bus."""

import math
import socket
import threading
import time

import pytest
import zenoh

from api_schemas import bus
from api_schemas.bus import Command, CommandKind, Heartbeat
from api_schemas.robot import OfferReply, RobotState
from robot_farm.link.bus_access import Access
from robot_farm.link.bus_link import BusLink
from tests.unit.conftest import lease

WITHIN_S = 120.0


@pytest.fixture
def dispatcher():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    config = zenoh.Config.from_json5(bus.session_config_json(mode="router", listen=[endpoint]))
    with zenoh.open(config) as session:
        yield session, endpoint


@pytest.fixture
def link(dispatcher):
    quiet = {"live": lambda: None, "on_cancel": lambda *_: None, "stopping": lambda: False}
    with BusLink(Access((dispatcher[1],), "farm"), "robot-0", "real", **quiet) as link:
        yield link


def _ask(session: zenoh.Session, key: str, message) -> OfferReply:
    give_up_s = time.monotonic() + WITHIN_S
    while time.monotonic() < give_up_s:
        for reply in session.get(key, payload=message.model_dump_json(), timeout=5.0):
            assert reply.ok is not None
            return OfferReply.model_validate_json(reply.ok.payload.to_bytes())
    raise AssertionError(f"no answer on {key}")


def _heartbeat(session: zenoh.Session, state: RobotState) -> Heartbeat:
    beats: list[Heartbeat] = []

    def hear(sample: zenoh.Sample) -> None:
        beats.append(Heartbeat.model_validate_json(sample.payload.to_bytes()))

    with session.declare_subscriber(bus.heartbeat_key("farm", "robot-0"), hear):
        give_up_s = time.monotonic() + WITHIN_S
        while not any(beat.state is state for beat in beats):
            assert time.monotonic() < give_up_s, beats
            time.sleep(0.02)
    return next(beat for beat in beats if beat.state is state)


def test_out_of_service_and_back(dispatcher, link):
    session, _ = dispatcher
    link.out_of_service("camera180 sees nothing of the resting object")
    assert _heartbeat(session, RobotState.OUT_OF_SERVICE).reason == "camera180 sees nothing of the resting object"
    declined = _ask(session, bus.offer_key("farm", "robot-0"), lease())
    assert (declined.accepted, link.next_lease(0.0)) == (False, None)
    assert "camera180" in str(declined.reason)
    assert not link.resume_asked()
    assert _ask(session, bus.command_key("farm", "robot-0"), Command(kind=CommandKind.RESUME)).accepted
    assert link.resume_asked()
    assert not link.resume_asked()
    link.out_of_service(None)
    assert _heartbeat(session, RobotState.IDLE).reason is None
    assert _ask(session, bus.offer_key("farm", "robot-0"), lease()).accepted


def test_a_robot_that_breaks_in_a_trial_is_out_of_service_when_the_trial_ends(dispatcher, link):
    session, _ = dispatcher
    assert _ask(session, bus.offer_key("farm", "robot-0"), lease()).accepted
    accepted = link.next_lease(WITHIN_S)
    assert accepted is not None
    link.running()
    link.out_of_service("joint finger0_base_to_upper is stuck")
    assert _heartbeat(session, RobotState.RUNNING).reason is not None
    link.finishing()
    assert not _ask(session, bus.offer_key("farm", "robot-0"), lease(ordinal=1)).accepted
    link.free(accepted.lease)
    assert _heartbeat(session, RobotState.OUT_OF_SERVICE).trial_id is None


def test_resuming_a_robot_in_service_asks_for_no_test(dispatcher, link):
    session, _ = dispatcher
    assert _ask(session, bus.command_key("farm", "robot-0"), Command(kind=CommandKind.RESUME)).accepted
    assert not link.resume_asked()


def test_the_end_of_a_trial_is_told_at_once(dispatcher, monkeypatch):
    monkeypatch.setattr(bus, "HEARTBEAT_EVERY_S", 1000.0)  # none comes by itself
    session, endpoint = dispatcher
    states: list[RobotState] = []
    with (
        session.declare_subscriber(
            bus.heartbeat_key("farm", "robot-0"),
            lambda sample: states.append(Heartbeat.model_validate_json(sample.payload.to_bytes()).state),
        ),
        BusLink(
            Access((endpoint,), "farm"), "robot-0", "real", live=lambda: None, on_cancel=lambda *_: None, stopping=lambda: False
        ) as link,
    ):
        give_up_s = time.monotonic() + WITHIN_S
        while RobotState.RUNNING not in states:  # until the bus knows that somebody listens
            link.running()
            assert time.monotonic() < give_up_s, states
            time.sleep(0.05)
        link.finishing()
        while states[-1] is not RobotState.IDLE:
            assert time.monotonic() < give_up_s, states
            time.sleep(0.02)


def test_a_number_that_is_not_finite_does_not_end_the_showing(dispatcher):
    session, endpoint = dispatcher
    numbers, shown = iter([math.nan, math.inf]), []

    def live():
        at = {"simulated_s": next(numbers, 1.0), "duration_s": 15.0, "joint_position_rad": (0.0,) * 9}
        at |= {"tracked_cube_position_world_m": (0.0,) * 3, "tracked_cube_quat_wxyz": (1.0, 0.0, 0.0, 0.0)}
        return bus.LiveState(robot="robot-0", trial_id="j1-000", fence=1, **at)

    with (
        session.declare_subscriber(bus.live_key("farm", "robot-0"), shown.append),
        BusLink(
            Access((endpoint,), "farm"), "robot-0", "real", live=live, on_cancel=lambda *_: None, stopping=lambda: False
        ) as link,
    ):
        link.running()
        give_up_s = time.monotonic() + WITHIN_S
        while not shown:
            assert time.monotonic() < give_up_s, "nothing was shown any more"
            time.sleep(0.02)


def test_who_asks_for_it_back_while_it_is_looked_at_is_heard_the_next_time():
    class AskedMeanwhile(threading.Event):
        def is_set(self):
            was = super().is_set()
            self.set()
            return was

    link = BusLink(Access((), "farm"), "robot-0", "real", live=lambda: None, on_cancel=lambda *_: None, stopping=lambda: False)
    link._resume_asked = AskedMeanwhile()
    assert [link.resume_asked(), link.resume_asked()] == [False, True]
