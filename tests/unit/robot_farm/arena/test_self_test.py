"""A self-test names the joint or the camera that is wrong, and passes robots that are only not alike."""

import contextlib

import numpy as np
import pytest

from robot_farm.arena.self_test import wrong_joint, wrong_sight
from robot_farm.faults import parse_fault
from robot_farm.hidden_physics import HiddenPhysics
from robot_farm.life import Life
from robot_farm.link.lease_keeper import TrialStoppedError
from robot_farm.settings import Reset
from sim_backend.driver.driver import hold_command
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import Tracker
from sim_backend.tasks.task import draw_start
from sim_backend.trifinger.objects import CUBE


def _found(*specs: str, physics: str = "nominal") -> str | None:
    faults = tuple(parse_fault(f"robot-0:{spec}") for spec in specs)
    return Life("robot-0", HiddenPhysics(b"secret", "robot-0", physics).of_trial, Reset.SWEEP, faults).test_again(lambda: None)


@pytest.mark.parametrize("physics", ["nominal", "mild", "real"])
def test_a_robot_without_fault_passes(physics):
    assert _found(physics=physics) is None


@pytest.mark.parametrize("joint", ["finger0_base_to_upper", "finger120_upper_to_middle", "finger240_middle_to_lower"])
def test_a_stuck_joint_is_named(joint):
    assert f"joint {joint} is" in str(_found(f"stuck_joint:{joint}"))


@pytest.mark.parametrize(
    ("ends_with", "found"),
    [(None, "passed"), (TrialStoppedError("stopped"), None), (ValueError("odd"), "the self-test broke off: ValueError: odd")],
)
def test_outside_a_lease_it_holds_its_turn(ends_with, found, monkeypatch):
    life, turns = Life("robot-0", HiddenPhysics(b"secret", "robot-0", "nominal").of_trial, Reset.SWEEP), []

    @contextlib.contextmanager
    def turn():
        turns.append("taken")
        yield

    def ending(_stop_reason):
        assert turns == ["taken"]
        if ends_with is not None:
            raise ends_with

    monkeypatch.setattr(life, "test_again", ending)
    assert life.test_in_turn(turn(), lambda: None) == found
    assert life.wrong == (found if isinstance(ends_with, ValueError) else None)


@pytest.mark.parametrize("size", ["0.3", "-0.3"])
def test_an_encoder_that_is_off_is_named(size):
    assert "joint finger240_base_to_upper is" in str(_found(f"encoder_jump:finger240_base_to_upper:{size}"))


@pytest.mark.parametrize("camera", ["camera60", "camera180", "camera300"])
def test_a_dead_camera_is_named(camera):
    assert _found(f"dead_camera:{camera}") == f"{camera} sees nothing of the resting object"


def test_errors_within_the_tolerance_are_none():
    assert wrong_joint(np.full(9, 0.09)) is None


@pytest.fixture(scope="module")
def reports():
    driver, tracker, seen = SimulatedDriver(), Tracker(), []
    start = draw_start(np.random.default_rng(4))
    driver.reset(start)
    tracker.reset(driver.measure())
    for step in range(100, 1300, 100):
        tracker.capture(driver.advance([(hold_command(start.joint_position_rad), 100)]))
        seen += tracker.deliver(step)
    return seen


def test_a_perfect_tracker_passes(reports):
    assert len(reports) >= 10
    assert wrong_sight(reports, CUBE) is None


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda i, r: {"confidence": np.array([0.7])}, "mean confidence of 0.70"),
        (lambda i, r: {"raw_position_world_m": np.add(r.raw_position_world_m, [0.05 * (-1) ** i, 0, 0])}, "50 mm off"),
        (lambda i, r: {"raw_position_world_m": np.add(r.raw_position_world_m, [0, 0, 0.015])}, "15 mm from its height"),
        (lambda i, r: {"raw_quat_wxyz": np.array([[np.cos(0.3 * i), 0, 0, np.sin(0.3 * i)]])}, "turned by"),
    ],
)
def test_the_laboratorys_limits(reports, change, says):
    wrong = [report._replace(**change(i, report)) for i, report in enumerate(reports)]
    assert says in str(wrong_sight(wrong, CUBE))


def test_a_tracker_that_reports_nothing_is_noticed():
    assert "no camera reported anything" in str(wrong_sight([], CUBE))
