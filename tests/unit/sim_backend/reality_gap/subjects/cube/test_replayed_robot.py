"""What pushes are replayed with."""

import numpy as np
import pytest

from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.knowledge.cube import DELAY, ENCODER_OFFSET, NOMINAL, PUSHED, Trial
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.cube.replayed_robot import NOMINAL_ROBOT, ReplayedRobot, absent_values
from sim_backend.trifinger import constants as c

FOUND = Physics.of(
    1,
    {
        "coulomb_friction.torque_nm": 0.04,
        "velocity_filter.time_constant_s": 0.003,
        "thermal_derating.loss_per_k": 0.001,
        ENCODER_OFFSET: [np.linspace(-0.01, 0.01, 9)],
    },
)


def test_a_base_has_the_mechanics_of_joints_and_takes_offsets_out_of_positions():
    base = ReplayedRobot.of(FOUND)
    assert set(base.physics.given) == {"coulomb_friction.torque_nm"}
    time_s, position = np.arange(5) * 1e-3, np.ones((5, 9))
    recording = Recording("a", "simulated", 1e-3, time_s, JointSignals(c.JOINT_NAMES, position))
    (moved,) = base.as_it_was([recording])
    assert moved.joints is not None and np.allclose(moved.joints.position_rad, 1.0 - np.linspace(-0.01, 0.01, 9))
    assert NOMINAL_ROBOT.as_it_was([recording]) == [recording]


def test_torques_are_replayed_when_they_acted():
    robot = ReplayedRobot.of(Physics.of(1, {DELAY: [np.repeat([0.0015, 0.0, 0.002], 3)]}))
    torque = np.repeat(np.arange(6.0)[:, None], 9, axis=1)
    joints = JointSignals(c.JOINT_NAMES, np.zeros((6, 9)), commanded_torque_nm=torque)
    (late,) = robot.as_it_was([Recording("a", "simulated", 1e-3, np.arange(6) * 1e-3, joints)])
    assert late.joints is not None and late.joints.commanded_torque_nm is not None
    found = late.joints.commanded_torque_nm[:, [0, 3, 6]]
    assert found[:, 0].tolist() == pytest.approx([0.0, 0.0, 0.5, 1.5, 2.5, 3.5])
    assert found[:, 1:].T.tolist() == [[0.0, 1.0, 2.0, 3.0, 4.0, 5.0], [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]]
    assert not robot.physics.given, "a replay begins without any torque on its way"


def test_only_a_base_of_nothing_is_nominal():
    assert NOMINAL_ROBOT.is_nominal and ReplayedRobot.of(Physics.nominal()).is_nominal
    assert not any(NOMINAL_ROBOT.moved(effect, [0.01] * len(absent_values(effect))).is_nominal for effect in PUSHED)
    assert not ReplayedRobot.of(FOUND).is_nominal


@pytest.mark.parametrize("effect", PUSHED)
def test_an_effect_that_is_taken_away_is_absent(effect):
    base = NOMINAL_ROBOT.moved(effect, [0.02] * len(absent_values(effect)))
    assert base.values(effect) == pytest.approx(absent_values(effect) + 0.02)
    assert np.array_equal(NOMINAL_ROBOT.values(effect), absent_values(effect))


def test_factors_are_of_what_the_base_has_and_stay_within_bounds():
    base = NOMINAL_ROBOT.moved("table_friction", [-0.5]).moved("table_friction", [0.2])
    assert base.values("table_friction") == pytest.approx(0.6)
    tried = base.tried(Trial("table_friction", 0.7, {"table_friction.coefficient": 0.7}))
    assert tried.value("table_friction.coefficient") == pytest.approx(0.42)
    assert base.moved("table_friction", [-5.0]).values("table_friction") == pytest.approx(0.05)


def test_a_cube_is_seen_where_the_tracker_is_off_and_placed_back():
    base = NOMINAL_ROBOT.moved("tracking_offset", [0.002, -0.001, 0.003]).moved("tracking_scale", [0.01])
    place_m = np.array([[0.05, -0.03]])
    seen_m = base.seen_m(NOMINAL, place_m)
    assert seen_m == pytest.approx(place_m * 1.01 + [[0.002, -0.001]])
    trial = Trial("tracking_offset_x", 0.004, {}, bias_m=(0.004, 0.0))
    assert base.place_m(trial, base.seen_m(trial, place_m)) == pytest.approx(place_m)
    larger = base.moved("cube_size", [0.02])
    assert larger.rest_height_m == pytest.approx(1.02 * 1.01 * c.CUBE_REST_HEIGHT_M + 0.003 - c.CUBE_REST_HEIGHT_M)
