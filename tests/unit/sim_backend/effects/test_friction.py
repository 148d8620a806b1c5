"""Each friction does what physics says it must."""

import math

import numpy as np
import pytest

from sim_backend.effects.friction import stribeck_bound_nm
from tests.unit.sim_backend.effects.rig import UNDAMPED, WEIGHTLESS, only, rig, run

JOINT = 0
LOCKED = {"stuck_joint.holding_torque_nm": np.where(np.arange(9) == JOINT, 0.0, 20.0)[None]}
FREE = WEIGHTLESS | UNDAMPED | LOCKED
"""One joint moves, the others stand, so that friction in them does not matter."""
CREEP_RAD = 1e-3
"""Of a stuck joint within a second: the solver's constraints are soft."""


def moved_rad(values: dict, torque_nm: float, steps: int = 1000) -> float:
    segment = run(rig(FREE | values), only(JOINT, torque_nm), steps)
    return float(segment.true_joint_position_rad[0, -1, JOINT] - segment.true_joint_position_rad[0, 0, JOINT])


def speed_rad_s(values: dict, torque_nm: float, steps: int = 40) -> float:
    """After a short push from rest: in proportion to the torque that friction leaves."""
    return float(run(rig(FREE | values), only(JOINT, torque_nm), steps).true_joint_velocity_rad_s[0, -1, JOINT])


def test_below_coulomb_friction_a_joint_is_stuck_and_above_it_the_rest_drives():
    friction = {"coulomb_friction.torque_nm": 0.03}
    assert abs(moved_rad(friction, 0.025)) < CREEP_RAD
    assert abs(moved_rad(friction, -0.025)) < CREEP_RAD
    assert speed_rad_s(friction, 0.05) == pytest.approx(speed_rad_s({}, 0.02), rel=0.03)


def test_coulomb_friction_counts_the_same_with_moving_bounds():
    """The bound of the solver's constraint and the one set in every step are one law."""
    coulomb = WEIGHTLESS | {"coulomb_friction.torque_nm": 0.03}
    native, moved = (
        run(rig(values), only(JOINT, 0.06), 40).true_joint_velocity_rad_s[0, -1]
        for values in (coulomb, coulomb | {"load_friction.coefficient": 1e-12})
    )
    assert moved == pytest.approx(native, rel=1e-6, abs=1e-9)


def test_viscous_friction_limits_the_speed():
    values = {"viscous_friction.damping_nm_s_rad": np.where(np.arange(9) == JOINT, 0.1, 0.0)[None]}
    segment = run(rig(FREE | values), only(JOINT, 0.05), 600)
    assert segment.true_joint_velocity_rad_s[0, -1, JOINT] == pytest.approx(0.5, rel=0.02)


def test_stribeck_friction_holds_at_rest_and_is_gone_at_speed():
    values = {"coulomb_friction.torque_nm": 0.02, "stribeck_friction.extra_nm": 0.03, "stribeck_friction.speed_rad_s": 0.05}
    assert abs(moved_rad(values, 0.04)) < CREEP_RAD
    assert abs(moved_rad({"coulomb_friction.torque_nm": 0.02}, 0.04)) > 0.05
    driver = rig(FREE | values)
    run(driver, only(JOINT, 0.2), 100)
    before, after = (run(driver, only(JOINT, 0.1), 20).true_joint_velocity_rad_s[0, 0, JOINT] for _ in range(2))
    plain = rig(FREE | {"coulomb_friction.torque_nm": 0.02})
    run(plain, only(JOINT, 0.2), 100)
    plain_before, plain_after = (run(plain, only(JOINT, 0.1), 20).true_joint_velocity_rad_s[0, 0, JOINT] for _ in range(2))
    assert before > 0.5
    assert after - before == pytest.approx(plain_after - plain_before, rel=0.02)


def test_stribeck_friction_falls_off_as_its_exponent_says():
    bound_nm = [stribeck_bound_nm(0.03, 0.1, exponent, -0.05) for exponent in (1.0, 2.0, 3.0)]
    assert bound_nm == pytest.approx([0.03 * math.exp(-0.5), 0.03 * math.exp(-0.25), 0.03 * math.exp(-0.125)])
    values = {"stribeck_friction.extra_nm": 0.03, "stribeck_friction.speed_rad_s": 1.0}
    speeds = [speed_rad_s(values | {"stribeck_friction.exponent": by}, 0.05) for by in (1.0, 2.0)]
    assert speeds[0] > 1.05 * speeds[1], "below the speed at which both have fallen to 1/e the bell holds more"


@pytest.mark.parametrize("torque_nm", [0.05, 0.3])
def test_load_friction_takes_its_share_of_any_torque(torque_nm: float):
    assert speed_rad_s({"load_friction.coefficient": 0.3}, torque_nm) == pytest.approx(speed_rad_s({}, 0.7 * torque_nm), rel=0.02)


def test_load_friction_takes_its_share_of_the_weight_that_moves_an_idle_joint():
    falls = [
        float(run(rig(UNDAMPED | LOCKED | values), only(JOINT, 0.0), 20).true_joint_velocity_rad_s[0, -1, JOINT])
        for values in ({}, {"load_friction.external_coefficient": 0.3})
    ]
    assert abs(falls[0]) > 0.05
    assert falls[1] == pytest.approx(0.7 * falls[0], rel=0.02)


def test_directional_friction_differs_with_the_sign_of_speed():
    values = {"coulomb_friction.torque_nm": 0.03, "directional_friction.difference_nm": 0.02}
    driver = rig(FREE | values)
    run(driver, only(JOINT, 0.3), 60)
    fast = [run(driver, only(JOINT, 0.1), 20).true_joint_velocity_rad_s[0, 0, JOINT] for _ in range(2)]
    other = rig(FREE | values)
    run(other, only(JOINT, -0.3), 60)
    slow = [run(other, only(JOINT, -0.1), 20).true_joint_velocity_rad_s[0, 0, JOINT] for _ in range(2)]
    gain = [pair[1] - pair[0] for pair in (fast, slow)]
    assert gain[0] / -gain[1] == pytest.approx((0.1 - 0.05) / (0.1 - 0.01), rel=0.1)


def test_a_stuck_joint_stays_where_it_is():
    values = {"stuck_joint.holding_torque_nm": np.where(np.arange(9) == 4, 20.0, 0.0)[None]}
    segment = run(rig(values), 0.39, 1000)
    travel = np.ptp(segment.true_joint_position_rad[0], axis=0)
    assert travel[4] < CREEP_RAD and np.delete(travel, 4).min() > 0.05
