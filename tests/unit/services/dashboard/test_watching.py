"""A running trial as it is watched: the model in the browser is the simulation's, and only its own lease is shown."""

import json

import numpy as np
import pytest

from api_schemas.bus import Heartbeat, LiveState
from services.dashboard.watch_page import MOST_OF_OWNER, MOST_WATCHING, Watching, message
from services.errors import TooMany
from services.jobs.claim import Claim
from sim_backend.trifinger import kinematics
from tests.unit.services.conftest import beat
from tests.unit.services.dashboard.robot_model import KEPT, made


def live(**more):
    return LiveState(
        robot="robot-0",
        trial_id="j1-000",
        fence=1,
        simulated_s=1.0,
        duration_s=15.0,
        joint_position_rad=(0.123456,) * 9,
        tracked_cube_position_world_m=(0.0, 0.1, 0.0325),
        tracked_cube_quat_wxyz=(1.0, 0.0, 0.0, 0.0),
        **more,
    )


def test_the_robot_in_the_browser_is_the_one_of_the_logs():
    assert json.loads(KEPT.read_text()) == made()


def test_its_joints_move_as_the_robots_do():
    model, angles = json.loads(KEPT.read_text()), np.random.default_rng(1).uniform(-0.5, 0.9, 9)
    links = {each["child"]: (each["parent"], np.array(each["pose"])) for each in model["fixed"]}
    for joint, angle in zip(model["joints"], angles, strict=True):
        turn = [np.cos(angle / 2), *(np.sin(angle / 2) * np.array(joint["axis"]))]
        links[joint["child"]] = (joint["parent"], np.array([*joint["origin_m"], *turn]))

    def place(frame):
        if frame == "world":
            return np.zeros(3), np.eye(3)
        parent, pose = links[frame]
        (at, turned), (w, x, y, z) = place(parent), pose[3:]
        own = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        return at + turned @ pose[:3], turned @ own

    tips = [place(each["child"])[0] for each in model["fixed"] if each["child"].endswith("_tip")]
    assert np.allclose(np.concatenate(tips), kinematics.fingertip_position_world_m(angles[None])[0], atol=1e-5)


def test_what_is_sent_is_small_and_of_old_robots_too():
    sent = json.loads(message(live(goal=(0.1,) * 7)))
    assert sent["joints"] == [0.1235] * 9 and sent["tracked"][:3] == [0, 0.1, 0.0325] and len(sent["goal"]) == 7
    assert json.loads(message(live()))["goal"] is None
    assert len(message(live(goal=(0.123456,) * 7))) < 400


def test_a_newer_robot_and_an_older_one_are_both_understood():
    words = beat("robot-0").model_dump_json()
    newer = json.dumps(json.loads(words) | {"what_comes_later": 1, "health": {"tracker_confidence": 0.5, "more": 1}})
    older = json.dumps({name: value for name, value in json.loads(words).items() if name != "health"})
    assert Heartbeat.model_validate_json(newer).health.tracker_confidence == 0.5
    assert Heartbeat.model_validate_json(older).health is None


def test_a_robot_that_only_tells_how_it_is_says_nothing_new(fleet_of):
    fleet = fleet_of("robot-0")
    warm = Heartbeat.model_validate(beat("robot-0").model_dump() | {"health": {"motor_temperature_rise_k": 9.0}})
    assert not fleet.heard(warm, 1001.0), "the dispatcher is not woken by it"
    assert fleet.member("robot-0").heartbeat.health.motor_temperature_rise_k == 9.0


def test_what_was_shown_of_a_trial_goes_with_its_lease(fleet_of):
    fleet = fleet_of("robot-0")
    claim = Claim("j1-000", 1, "robot-0")
    fleet.leased(claim, 1000.0)
    fleet.member("robot-0").live = live()
    fleet.freed(claim, done=True)
    assert fleet.member("robot-0").live is None


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity"])
def test_a_number_that_is_none_reaches_no_browser(number):
    said = json.loads(live(goal=(0.1,) * 9).model_dump_json())
    for name in (
        "simulated_s",
        "duration_s",
        "joint_position_rad",
        "tracked_cube_position_world_m",
        "tracked_cube_quat_wxyz",
        "goal",
    ):
        wrong = json.dumps(said | {name: [float(number)] if isinstance(said[name], list) else float(number)})
        with pytest.raises(ValueError, match="finite"):
            LiveState.model_validate_json(wrong)
    with pytest.raises(ValueError, match="JSON compliant"):
        message(live().model_copy(update={"duration_s": float(number)}))


def test_two_owners_leave_room_for_a_third():
    watching = Watching()
    for owner in ("ann", "bob"):
        for _ in range(MOST_OF_OWNER):
            watching.opened(owner)
        with pytest.raises(TooMany, match=f"{owner} already watches trials on {MOST_OF_OWNER} pages"):
            watching.opened(owner)
    for _ in range(MOST_WATCHING - 2 * MOST_OF_OWNER):
        watching.opened("carl")
    with pytest.raises(TooMany, match=f"{MOST_WATCHING} people already watch"):
        watching.opened("carl")
    watching.closed("ann")
    watching.opened("carl")
