"""The motor law along a motion against what the simulated driver does along its own."""

import numpy as np
import pytest

from sim_backend.driver.driver import Command, Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.subjects.joints.laws.motor_law import KEYS, VECTOR, JointMotion, absent_values, along, values_of
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.scene import compile_scene

STEPS_S, COMMANDS, HOLD = c.PHYSICS_STEP_S, 60, 20
BEGUN = slice(4, None)
"""Once what was sent first has arrived: the law takes a recording to begin in the middle of a motion, the driver from rest."""
NOT_MEASURED = np.full(COMMANDS * HOLD, np.nan)
PER_JOINT = np.linspace(1.0, 2.0, 9)
CASES = {
    "nothing": {},
    "a delay of whole steps": {"action_delay.delay_s": 0.003},
    "a delay between steps": {"action_delay.delay_s": 0.00275},
    "saturation": {"torque_saturation.limit_nm": 0.04 * PER_JOINT},
    "sag": {"supply_sag.loss_per_nm": 0.4},
    "torque constant": {"torque_constant.error": 0.05 * PER_JOINT},
    "heat": {"thermal_derating.loss_per_k": 0.01, "thermal_derating.rise_k_nm2": 2000.0, "thermal_derating.time_constant_s": 4.0},
    "cogging": {"cogging.amplitude_nm": 0.01 * PER_JOINT, "cogging.phase_rad": 0.7},
    "play": {"backlash.gap_rad": 0.01},
    "all": {
        "action_delay.delay_s": 0.0015,
        "torque_saturation.limit_nm": 0.1,
        "supply_sag.loss_per_nm": 0.2,
        "torque_constant.error": -0.1,
        "thermal_derating.loss_per_k": 0.005,
        "cogging.amplitude_nm": 0.01,
    },
}
FRICTION = {
    "coulomb": {"coulomb_friction.torque_nm": 0.01 * PER_JOINT},
    "load": {"load_friction.coefficient": 0.2},
    "load from outside": {"load_friction.external_coefficient": 0.2},
    "direction": {"coulomb_friction.torque_nm": 0.02, "directional_friction.difference_nm": 0.01},
    "stribeck": {"stribeck_friction.extra_nm": 0.02, "stribeck_friction.speed_rad_s": 0.3},
}


def driven(values):
    """A robot with some physics, its fingers far above everything, moved by random torques; a segment."""
    robot = Physics.of(1, {key: np.broadcast_to(v, (1, 9)) if KEYS_PER_JOINT[key] else v for key, v in values.items()})
    driver = SimulatedDriver(physics=robot)
    place = np.array([[0.0, 0.0, 1e5]]), np.array([[1.0, 0.0, 0.0, 0.0]])
    driver.reset(Start(np.tile([0.0, 1.2, -2.2], (1, 3)), *place, noise_seed=np.array([1])))
    rng = np.random.default_rng(8)
    centre = np.tile([0.0, 1.2, -2.2], 3)
    targets = [centre + 0.15 * rng.uniform(-1.0, 1.0, (1, 9)) for _ in range(COMMANDS)]
    return robot, driver.advance([(Command(np.zeros((1, 9)), target), HOLD) for target in targets])


KEYS_PER_JOINT = {key: Physics.nominal().value(key).ndim == 2 for key in KEYS}


def lawful(robot, segment, joint):
    """Current, net torque and play that the law makes of the same motion."""
    values = absent_values()
    for i, key in enumerate(KEYS):
        values[i] = np.ravel(robot.value(key)[0])[joint if KEYS_PER_JOINT[key] else 0]
    sent = np.ascontiguousarray(segment.applied_torque_nm[0])
    each = (segment.true_joint_position_rad, segment.true_joint_velocity_rad_s)
    position, velocity = (np.ascontiguousarray(series[0, :, joint]) for series in each)
    plant = Plant(compile_scene(), c.JOINT_NAMES)
    asked = plant.load_nm(segment.true_joint_position_rad[0], segment.true_joint_velocity_rad_s[0])[:, joint]
    total = np.abs(sent).sum(axis=1)
    motion = JointMotion(position, velocity)
    own = np.ascontiguousarray(sent[:, joint]), total, motion, np.ascontiguousarray(asked), NOT_MEASURED[: len(total)]
    return along(*own, STEPS_S, values)


def test_a_row_of_values_is_all_of_it():
    rows = np.arange(2.0 * len(VECTOR)).reshape(2, len(VECTOR))
    assert values_of(rows, 1) == tuple(rows[1])


@pytest.mark.parametrize("case", CASES)
def test_what_reaches_a_joint_is_what_the_driver_lets_through(case):
    robot, segment = driven(CASES[case])
    others = np.abs(segment.effective_torque_nm - segment.applied_torque_nm).max()
    assert others == 0.0 if case == "nothing" else others > 1e-3
    for joint in range(9):
        _, net, _ = lawful(robot, segment, joint)
        np.testing.assert_allclose(net[BEGUN], segment.effective_torque_nm[0, BEGUN, joint], atol=1e-9)


@pytest.mark.parametrize("case", ("nothing", "a delay between steps", "saturation", "sag"))
def test_the_board_measures_the_torque_of_the_current(case):
    robot, segment = driven(CASES[case])
    for joint in range(9):
        current, _, _ = lawful(robot, segment, joint)
        np.testing.assert_allclose(current[BEGUN], segment.measured_torque_nm[0, BEGUN, joint], atol=1e-9)


def test_torques_after_the_motor_are_not_measured():
    robot, segment = driven({"torque_constant.error": 0.1})
    current, net, _ = lawful(robot, segment, 0)
    np.testing.assert_allclose(current, segment.measured_torque_nm[0, :, 0], atol=1e-9)
    np.testing.assert_allclose(net, 1.1 * current, atol=1e-9)


@pytest.mark.parametrize("case", FRICTION)
def test_friction_takes_what_the_motion_does_not_show(case):
    robot, segment = driven(FRICTION[case])
    q, v = segment.true_joint_position_rad[0], segment.true_joint_velocity_rad_s[0]
    needed = Plant(compile_scene(), c.JOINT_NAMES).torque_nm(q[:-1], v[:-1], np.diff(v, axis=0) / STEPS_S)
    for joint in range(9):
        _, net, _ = lawful(robot, segment, joint)
        moving = (np.abs(v[:-1, joint]) > 0.15) & (np.abs(v[1:, joint]) > 0.15)
        taken = segment.effective_torque_nm[0, :-1, joint] - needed[:, joint]
        expected = segment.effective_torque_nm[0, :-1, joint] - net[:-1]
        assert moving.sum() > 100
        assert np.abs(expected[moving]).max() > 2e-3
        assert np.median(np.abs(taken - expected)[moving]) < 0.05 * np.abs(expected[moving]).max()


def test_a_joint_at_rest_feels_no_friction():
    values = absent_values()
    values[KEYS.index("coulomb_friction.torque_nm")] = 0.1
    rest = np.zeros(50)
    _, net, _ = along(np.full(50, 0.02), np.full(50, 0.02), JointMotion(rest, rest), rest, NOT_MEASURED[:50], STEPS_S, values)
    np.testing.assert_array_equal(net, np.full(50, 0.02))


def test_a_motor_whose_temperature_was_measured_is_as_warm_as_that_and_else_as_its_law_says():
    values, rest, sent = absent_values(), np.zeros(50), np.full(50, 0.02)
    values[KEYS.index("thermal_derating.loss_per_k")] = 0.004
    values[KEYS.index("thermal_derating.rise_k_nm2")] = 0.0
    measured = np.linspace(30.0, 40.0, 50)
    measured[:10] = np.nan
    _, net, _ = along(sent, sent, JointMotion(rest, rest), rest, measured, STEPS_S, values)
    np.testing.assert_array_equal(net[:10], sent[:10])
    np.testing.assert_allclose(net[10:], 0.02 * (1.0 - 0.004 * measured[10:]), rtol=1e-4)
