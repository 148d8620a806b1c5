"""A robot that the API does not answer says so on the bus, and takes no offers until it does."""

import threading
import time

import pytest
import zenoh

from api_schemas import bus
from api_schemas.bus import Heartbeat
from api_schemas.robot import OfferReply, RobotState
from robot_farm.link import api_link, lease_keeper, outage
from robot_farm.link.api_link import ApiLink, ApiUnreachableError, TokenEndedError
from robot_farm.link.bus_access import Access
from robot_farm.link.bus_link import BusLink
from robot_farm.link.lease_keeper import LeaseKeeper, TrialStoppedError
from robot_farm.link.outage import FIRST_PAUSE_S, LONGEST_PAUSE_S, Outage, Standing
from tests.integration.farm_process import free_port
from tests.unit.robot_farm.link.lease_api import LEASE_S, endless_trial, excitation_lease, serving, wait_until
from tests.unit.robot_farm.link.test_waiting_for_files import recorded_at_once

CLAIM = ("j1-000", 1)


@pytest.fixture
def steps(monkeypatch):
    """When a trial that would go on for ever asked whether it may."""
    steps: list[float] = []
    monkeypatch.setattr("robot_farm.robot.run_trial", endless_trial(steps))
    return steps


def look(robot, api):
    with ApiLink(api.url, "token") as link:
        robot._outage.look(lambda: link.try_out("robot-0"))
    return robot._outage.standing()


@pytest.mark.parametrize("status", [0, 503], ids=["no answer", "503"])
def test_a_trial_that_is_cut_off_ends_and_the_robot_waits_for_the_api(api, robot, clock, steps, status):
    with serving(robot, api):
        wait_until(lambda: api.times("/renew") and steps)
        assert robot._outage.standing() == Standing()
        api.status = status
        wait_until(lambda: robot._outage.standing().cut_off == CLAIM)
        assert robot._outage.standing().takes_offers, "the trial still runs, and the API may come back"
        cut_off_s = clock.monotonic()
    assert steps[-1] - cut_off_s < LEASE_S
    api.status = 503
    time.sleep(FIRST_PAUSE_S)
    waiting = look(robot, api)
    assert (waiting.takes_offers, waiting.api_away, waiting.cut_off) == (False, True, CLAIM)
    assert "/v1/robots/robot-0/token" in str(waiting.reason)
    api.status = 200
    wait_until(lambda: look(robot, api).takes_offers)
    assert robot._outage.standing() == Standing(cut_off=CLAIM), "the lease may end after the API has come back"


def test_an_api_that_comes_back_in_time_cuts_nothing_off(api, robot, steps):
    with serving(robot, api):
        wait_until(lambda: steps)
        api.status = 503
        wait_until(lambda: robot._outage.standing().cut_off == CLAIM)
        api.status = 200
        wait_until(lambda: robot._outage.standing() == Standing())
        api.status = 409
    assert robot._outage.standing() == Standing(), "it was told that the lease is no longer its own"


def test_an_api_that_fails_is_there(api, robot, steps):
    api.status = 500
    with serving(robot, api):
        pass
    assert robot._outage.standing() == Standing()


def test_a_run_that_hangs_is_no_outage(api, robot, monkeypatch):
    monkeypatch.setattr(lease_keeper, "SILENT_FOR_S", 0.75)
    api.status = 503
    goes_on = threading.Event()

    def hanging(*_, stop_reason, **__):
        assert goes_on.wait(60)
        raise TrialStoppedError(stop_reason())

    monkeypatch.setattr("robot_farm.robot.run_trial", hanging)
    with serving(robot, api):
        try:
            wait_until(lambda: not robot._outage.standing().takes_offers)
            assert robot._outage.standing() == Standing(robot._keeper.hangs, takes_offers=False)
        finally:
            goes_on.set()
    assert robot._outage.standing().cut_off is None


def test_a_log_that_could_not_be_brought_cuts_off_and_says_meanwhile_what_it_waits_for(api, robot, monkeypatch):
    recorded_at_once(monkeypatch)
    monkeypatch.setattr(api_link, "WAIT_FOR_S", 1.0)
    api.of_files = 503
    with serving(robot, api):
        wait_until(lambda: robot._outage.standing().reason)
        assert robot._outage.standing() == Standing("PUT /v1/leases/j1-000/1/log: status 503")
    assert robot._outage.standing().cut_off == CLAIM and not robot._outage.standing().takes_offers


def test_each_attempt_in_a_row_that_is_cut_off_doubles_the_pause_until_one_comes_home(api, monkeypatch):
    now_s, asked = [1000.0], []
    monkeypatch.setattr(outage, "time", type("Clock", (), {"monotonic": staticmethod(lambda: now_s[0])}))
    with ApiLink(api.url, "token") as link:
        waiting = Outage(lambda _text: None)

        def pause_s(*, home=False):
            waiting.begin(LeaseKeeper(link, excitation_lease(), lease_keeper.time.monotonic()))
            waiting.ended(ApiUnreachableError("away"))
            began_s = now_s[0]
            while not waiting.standing().takes_offers:
                now_s[0] += 1.0
                waiting.look(lambda: asked.append(1))
            if home:
                waiting.came_home()
            return now_s[0] - began_s

        pauses = [pause_s() for _ in range(10)]
        assert pauses[:4] == [1.0, 2.0, 4.0, 8.0] and pauses[-1] == LONGEST_PAUSE_S
        assert len(asked) == len(pauses), "each is answered, and none is asked for before its time"
        assert [pause_s(home=True), pause_s()] == [LONGEST_PAUSE_S, FIRST_PAUSE_S]


def test_a_token_that_ended_meanwhile_ends_the_robot(api, robot):
    with ApiLink(api.url, "token") as link:
        robot._outage.begin(LeaseKeeper(link, excitation_lease(), lease_keeper.time.monotonic()))
    robot._outage.ended(ApiUnreachableError("away"))
    api.status = 401
    time.sleep(FIRST_PAUSE_S)
    with pytest.raises(TokenEndedError):
        look(robot, api)


def test_the_bus_hears_it(monkeypatch):
    monkeypatch.setattr(bus, "HEARTBEAT_EVERY_S", 0.1)
    endpoint, beats, standing = f"tcp/127.0.0.1:{free_port()}", [], [Standing()]
    quiet = {"live": lambda: None, "on_cancel": lambda *_: None, "stopping": lambda: False, "standing": lambda: standing[0]}
    with zenoh.open(zenoh.Config.from_json5(bus.session_config_json(mode="router", listen=[endpoint]))) as session:

        def hear(sample):
            beats.append(Heartbeat.model_validate_json(sample.payload.to_bytes()))

        def offered():
            offer = excitation_lease(2).model_dump_json()
            (reply,) = session.get(bus.offer_key("farm", "robot-0"), payload=offer, timeout=120.0)
            return OfferReply.model_validate_json(reply.ok.payload.to_bytes())

        with (
            session.declare_subscriber(bus.heartbeat_key("farm", "robot-0"), hear),
            BusLink(Access((endpoint,), "farm"), "robot-0", "real", **quiet) as link,
        ):
            wait_until(lambda: beats and beats[-1].state == RobotState.IDLE)
            assert (beats[-1].api_away, beats[-1].cut_off_trial_id) == (False, None)
            standing[0] = Standing("the API does not answer", takes_offers=False, api_away=True, cut_off=CLAIM)
            wait_until(lambda: beats[-1].state == RobotState.OUT_OF_SERVICE)
            said = beats[-1]
            assert (said.cut_off_trial_id, said.cut_off_fence, said.api_away) == (*CLAIM, True)
            assert said.reason == "the API does not answer"
            assert offered() == OfferReply(accepted=False, reason="out of service: the API does not answer")
            link.out_of_service("a joint is stuck")
            wait_until(lambda: beats[-1].reason == "a joint is stuck")
            assert not beats[-1].api_away, "it would not serve if the API were there"
            link.out_of_service(None)
            standing[0] = Standing(cut_off=CLAIM)
            wait_until(lambda: beats[-1].state == RobotState.IDLE)
            assert offered().accepted
