"""A guarded bus: who has a token comes onto it as himself, says only what is his to say, and stays no longer than his token."""

import time
from importlib.metadata import version
from pathlib import Path

import pytest
import zenoh

from api_schemas import bus
from api_schemas.bus import Heartbeat, Identity
from api_schemas.robot import RobotState
from robot_farm.link.admission import renewed
from robot_farm.link.api_link import ApiLink, NotAdmittedError, NotExpectedError, own_token
from robot_farm.link.bus_access import Access, ask_access
from robot_farm.link.bus_link import BusLink
from robot_farm.settings import TOKEN_VARIABLE, parse
from tests.integration.farm_process import PATIENCE_S, services, until
from tests.stalls import stalls

LASTS_S = 10.0
"""Half of it is left when a robot asks anew: so long may a busy machine take to answer."""
QUIET = {"live": lambda: None, "on_cancel": lambda *_: None, "stopping": lambda: False}


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    with services(tmp_path_factory.mktemp("guarded") / "farm", link="tls", bus_robots=4, bus_certificate_s=LASTS_S) as running:
        yield running


@pytest.fixture
def told(farm, monkeypatch):
    """A robot's settings: an address and a token."""
    monkeypatch.setenv(TOKEN_VARIABLE, farm.tokens["robot"])
    return parse(["--api", farm.api])


def link_of(farm, robot):
    return ApiLink(farm.api, own_token(farm.api, farm.tokens["robot"], robot))


def access_of(farm, robot, told):
    with link_of(farm, robot) as api:
        return ask_access(api, robot, told)


def state(farm, robot):
    return {each["robot"]: each["state"] for each in farm.admin.get("/v1/robots").json()["robots"]}.get(robot)


def opened(identity, farm):
    text = bus.session_config_json(mode="client", connect=[farm.bus], identity=identity)
    return zenoh.open(zenoh.Config.from_json5(text))


def beat(robot):
    return Heartbeat(robot=robot, instance="forged", pid=1, host="elsewhere", state=RobotState.IDLE).model_dump_json()


def test_address_and_token_suffice_and_a_robot_says_only_what_is_its_own(farm, told):
    access = access_of(farm, "robot-0", told)
    assert (access.farm, access.endpoints) == ("farm", (farm.bus,))
    heard = []
    with (
        opened(access.identity, farm) as session,
        session.declare_subscriber("**", lambda sample: heard.append(str(sample.key_expr)), allowed_origin=zenoh.Locality.REMOTE),
        session.liveliness().declare_token(bus.alive_key("farm", "robot-1")),
        session.declare_queryable(bus.offer_key("farm", "robot-1"), lambda query: heard.append("an offer of another")),
    ):
        for _ in range(20):
            session.put(bus.heartbeat_key("farm", "robot-1"), beat("robot-1"))
            session.put(bus.change_key("farm"), bus.Change().model_dump_json())
            session.put(bus.heartbeat_key("farm", "robot-0"), beat("robot-0"))
            time.sleep(0.05)
        until(lambda: state(farm, "robot-0") is not None, PATIENCE_S, "what the robot says of itself to be heard")
        farm.submit(farm.policy(), trials=1)  # something happens that others hear of
        time.sleep(0.5)
    assert state(farm, "robot-1") is None
    assert heard == []


def test_without_a_certificate_of_the_farm_nobody_comes_onto_the_bus(farm, told):
    good = access_of(farm, "robot-0", told).identity
    assert good is not None
    with pytest.raises(zenoh.ZError):
        opened(None, farm)
    others = services_of_another_farm()
    for stranger in (others, Identity(others.certificate, others.key, good.authority)):
        with pytest.raises(zenoh.ZError):
            opened(stranger, farm)


def services_of_another_farm():
    from services.joining.authority import Authority
    from services.signing import FarmKey

    return Authority.of(FarmKey(bytes(32))).of_services()


def test_a_wrong_token_gets_nothing(farm, told):
    with pytest.raises(NotAdmittedError, match="401"):
        own_token(farm.api, "trifarm_x_wrong", "robot-0")
    with ApiLink(farm.api, "trifarm_x_wrong") as api, pytest.raises(NotAdmittedError, match="token-unknown"):
        ask_access(api, "robot-0", told)
    with link_of(farm, "robot-0") as api, pytest.raises(NotAdmittedError, match="token-of-another-robot"):
        ask_access(api, "robot-1", told)
    with ApiLink(farm.api, farm.tokens["robot"]) as api, pytest.raises(NotAdmittedError, match="token-of-no-robot"):
        ask_access(api, "robot-0", told)
    with link_of(farm, "robot-4") as api, pytest.raises(NotExpectedError, match="robot-not-expected"):
        ask_access(api, "robot-4", told)


def test_a_robot_that_is_too_old_is_told_so(farm, told, monkeypatch):
    major, minor, *_ = version("trifarm").split(".")
    monkeypatch.setattr("robot_farm.link.bus_access.version", lambda _: f"{major}.{int(minor) + 1}.0")
    access_of(farm, "robot-2", told)  # a neighbour
    monkeypatch.setattr("robot_farm.link.bus_access.version", lambda _: "1.0.0")
    with pytest.raises(NotAdmittedError, match=r"services' version .* is too old"):
        access_of(farm, "robot-2", told)


def test_a_certificate_is_renewed_unnoticed_until_the_token_is_revoked(farm, told):
    robot = "robot-3"
    with link_of(farm, robot) as api:
        said, seen = [], set()
        access = ask_access(api, robot, told)
        with BusLink(access, robot, "nominal", **QUIET) as link:
            until(lambda: state(farm, robot) == "idle", PATIENCE_S, "the robot")
            ends_s = time.monotonic() + 1.2 * LASTS_S
            with stalls() as stalled:
                while time.monotonic() < ends_s or said.count("has a new certificate for the bus") < 2:
                    access = renewed(access, lambda: ask_access(api, robot, told), link, said.append)
                    seen.add(state(farm, robot))
                    time.sleep(0.1)
            assert "lost" not in seen or stalled.seconds > 0.3 * LASTS_S, "half of the time was left when it asked anew"
            tokens = {each["robot"]: each["token_id"] for each in farm.admin.get("/v1/tokens").json()["tokens"]}
            assert farm.admin.delete(f"/v1/tokens/{tokens[robot]}").status_code == 204
            with pytest.raises(NotAdmittedError, match="token-revoked"):
                ask_access(api, robot, told)
            until(lambda: state(farm, robot) == "lost", PATIENCE_S, "the link to end with the certificate")


def test_an_open_bus_is_told_and_what_the_robot_was_told_itself_wins(tmp_path, monkeypatch):
    with services(tmp_path / "farm", bus_addresses="tcp/0.0.0.0:1234") as farm:
        monkeypatch.setenv(TOKEN_VARIABLE, farm.tokens["robot"])
        with link_of(farm, "robot-0") as api:
            asked = ask_access(api, "robot-0", parse(["--api", farm.api]))
            assert asked == Access(("tcp/127.0.0.1:1234",), "farm")  # on all addresses: that of the API is one of them
            told = ask_access(api, "robot-0", parse(["--api", farm.api, "--bus", farm.bus, "--farm", "other"]))
            assert told == Access((farm.bus,), "other")
    assert not Path("robot-data").exists()
