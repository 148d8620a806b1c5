"""Pushes replayed."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.driver.driver import Start, hold_command
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.knowledge.cube import NOMINAL, Trial
from sim_backend.reality_gap.subjects.cube.replay import FORCE_STD_N, PLACE_STD_M, PushReplay
from sim_backend.reality_gap.subjects.cube.replayed_robot import ReplayedRobot
from sim_backend.reality_gap.subjects.cube.windows import LENGTH_S, PushWindow
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m

STEPS = round(LENGTH_S / c.PHYSICS_STEP_S)
FRAMES = np.arange(0, STEPS, 100)
BIAS = Trial("tracking_offset_x", 0.004, {}, bias_m=(0.004, 0.0))


def _held(pushed_back_nm: float = 0.0, physics: Physics | None = None) -> PushWindow:
    """A finger that is held still far from the cube, with a torque that the log says acted and did not."""
    driver, start = SimulatedDriver(physics=physics), c.START_JOINT_POSITION_RAD
    driver.reset(Start(start[None], np.array([[0.05, 0.0, c.CUBE_REST_HEIGHT_M]]), np.array([[1.0, 0.0, 0.0, 0.0]])))
    driver.advance([(hold_command(start[None]), 1000)])
    segment = driver.advance([(hold_command(start[None]), STEPS)])
    position, torque = segment.joint_position_rad[0], segment.applied_torque_nm[0].copy()
    torque[:, 1] -= pushed_back_nm
    jacobian = np.empty((STEPS, 3, 3))
    for joint in range(3):
        ahead = position.copy()
        ahead[:, joint] += 1e-6
        change = fingertip_position_world_m(ahead) - fingertip_position_world_m(position)
        jacobian[:, :, joint] = change[:, :3] / 1e-6
    return PushWindow(
        finger=0,
        contact_s=0.1,
        joint_position_rad=position,
        joint_velocity_rad_s=segment.joint_velocity_rad_s[0],
        torque_nm=torque,
        tip_m=fingertip_position_world_m(position)[:, :3],
        jacobian_m=jacobian,
        cube_xy_m=np.array([0.05, 0.0]),
        cube_yaw_rad=0.0,
        frames_before=10,
        frame_steps=FRAMES,
        frame_xy_m=segment.cube_position_world_m[0, FRAMES, :2],
        frame_yaw_rad=np.zeros(len(FRAMES)),
        direction=np.array([1.0, 0.0]),
        speed_m_s=0.0,
    )


@pytest.fixture(scope="module")
def replay() -> PushReplay:
    return PushReplay((NOMINAL, BIAS))


def test_what_the_nominal_robot_did_leaves_nothing(replay):
    assert np.abs(replay.replay([_held()])[0].residual).max() < 0.1


def test_a_torque_that_is_missing_shows_as_a_force_at_the_tip(replay):
    missing_nm = 0.02
    found = replay.replay([_held(missing_nm)])[0]
    force_n = FORCE_STD_N * np.array([found.residual[0][found.channel == k].mean() for k in range(3)])
    expected = np.linalg.solve(_held().jacobian_m[0].T, np.array([0.0, -missing_nm, 0.0]))
    assert np.linalg.norm(force_n) == pytest.approx(np.linalg.norm(expected), rel=0.1)
    assert force_n[2] == pytest.approx(expected[2], rel=0.2)


def test_a_tracker_that_is_off_is_off_before_and_after(replay):
    found = replay.replay([_held()] * 7)
    assert len(found) == 7
    place = found[6].residual[1][found[6].channel == 3]
    assert place == pytest.approx(np.zeros(len(FRAMES)), abs=0.01 / PLACE_STD_M * 0.01)


def test_a_robot_that_is_known_leaves_nothing_and_what_is_not_known_of_it_shows():
    heavy = Physics.of(1, {"link_mass.factor": 1.5})
    known, unknown = (
        _largest_force(PushReplay((NOMINAL, BIAS), base=base), heavy) for base in (ReplayedRobot.of(heavy), ReplayedRobot())
    )
    assert known < 0.1
    assert unknown > 0.3


def _largest_force(replay: PushReplay, physics: Physics) -> float:
    (push,) = replay.replay([_held(physics=physics)])
    return float(np.abs(push.residual[0][push.channel < 3]).max())


def test_a_tracker_that_is_known_to_be_off_leaves_nothing():
    window, off_m = _held(), np.array([0.004, 0.0])
    seen = replace(window, cube_xy_m=window.cube_xy_m + off_m, frame_xy_m=window.frame_xy_m + off_m)
    base = ReplayedRobot().moved("tracking_offset", [*off_m, 0.0])
    (push,) = PushReplay((NOMINAL, BIAS), base=base).replay([seen])
    assert np.abs(push.residual[0]).max() < 0.1
