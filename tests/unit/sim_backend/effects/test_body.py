"""Each effect of links, joints and gravity does what physics says it must."""

import numpy as np
import pytest

from sim_backend.driver.robot_model import robot_spec
from sim_backend.effects.physics import Physics
from sim_backend.trifinger.scene import build_scene
from tests.unit.sim_backend.effects.rig import UNDAMPED, WEIGHTLESS, c, only, rig, run, start_of

JOINT = 0
ALONE = {"stuck_joint.holding_torque_nm": np.where(np.arange(9) == JOINT, 0.0, 20.0)[None]}
FREE = WEIGHTLESS | UNDAMPED | ALONE


def inertia_kg_m2(values: dict) -> float:
    """Torque over acceleration of one joint while the others stand."""
    speed = run(rig(FREE | values), only(JOINT, 0.1), 11).true_joint_velocity_rad_s[0, -1, JOINT]
    return 0.1 * 0.01 / speed


def model(values: dict):
    return robot_spec(Physics.of(1, values), physics_step_s=0.001).compile()


def test_links_scale_in_mass_and_inertia():
    assert inertia_kg_m2({"link_mass.factor": 1.5}) == pytest.approx(1.5 * inertia_kg_m2({}), rel=1e-3)
    factors = np.linspace(0.6, 1.4, 9)
    heavier, nominal = model({"link_mass.factor": factors[None]}), build_scene().compile()
    for index, factor in enumerate(factors):
        finger, link = c.FINGER_NAMES[index // 3], ("upper", "middle", "lower")[index % 3]
        for name in {f"{finger}_{link}", *([f"{finger}_tip"] if link == "lower" else [])}:
            assert heavier.body(name).mass == pytest.approx(factor * nominal.body(name).mass)
            assert heavier.body(name).inertia == pytest.approx(factor * nominal.body(name).inertia)


def test_rotor_inertia_adds_to_the_joint():
    armature = 0.001
    added = inertia_kg_m2({"rotor_inertia.armature_kg_m2": armature}) - inertia_kg_m2({})
    assert added == pytest.approx(armature, rel=1e-2)


def test_a_stiff_cable_balances_a_torque():
    stiffness, rest = 0.4, 0.25
    values = {"joint_stiffness.stiffness_nm_rad": stiffness, "joint_stiffness.reference_rad": rest}
    driver = rig(WEIGHTLESS | ALONE | values | {"viscous_friction.damping_nm_s_rad": 0.05})
    segment = run(driver, only(JOINT, 0.08), 4000)
    assert segment.true_joint_position_rad[0, -1, JOINT] == pytest.approx(rest + 0.08 / stiffness, abs=1e-3)


def test_limits_move():
    driver = rig(WEIGHTLESS | ALONE | {"joint_limits.upper_rad": -0.2})
    reached = run(driver, only(JOINT, 0.05), 3000).true_joint_position_rad[0, -1, JOINT]
    assert reached == pytest.approx(c.SOFT_LIMIT_UPPER_RAD[JOINT] - 0.2, abs=0.02)


def test_a_tilted_table_turns_gravity_and_the_cube_slides_if_it_is_smooth():
    tilt = 0.15
    gravity = model({"table_tilt.roll_rad": tilt}).opt.gravity
    assert np.linalg.norm(gravity) == pytest.approx(c.GRAVITY_M_S2)
    assert gravity[2] == pytest.approx(-c.GRAVITY_M_S2 * np.cos(tilt))
    values = {"table_tilt.pitch_rad": tilt, "table_friction.coefficient": 0.05, "stuck_joint.holding_torque_nm": 20.0}
    segment = run(rig(values), 0.0, 300)
    sign = np.sign(model({"table_tilt.pitch_rad": tilt}).opt.gravity[0])
    slides_m = segment.cube_position_world_m[0, 100:]
    acceleration = 2 * np.polyfit(np.arange(200) / 1000, slides_m[:, 0], 2)[0]
    assert acceleration == pytest.approx(sign * c.GRAVITY_M_S2 * (np.sin(tilt) - 0.05 * np.cos(tilt)), rel=0.05)
    assert np.ptp(slides_m[:, 1]) < 1e-4
    held = run(rig(values | {"table_friction.coefficient": 0.3}), 0.0, 300)
    assert np.abs(held.cube_position_world_m[0, -1, :2]).max() < 1e-3


def test_gravity_is_what_a_falling_cube_feels():
    driver = rig({"gravity.offset_m_s2": [[0.5, -0.3, 1.0]]}, start=start_of(cube=(0.0, 0.0, 0.3)))
    fall = run(driver, 0.0, 101).cube_position_world_m[0]
    # MuJoCo adds acceleration before motion: n (n + 1) / 2 steps of a dt^2
    steps = 100
    assert fall[-1] - fall[0] == pytest.approx(
        np.array([0.5, -0.3, 1.0 - c.GRAVITY_M_S2]) * 1e-6 * steps * (steps + 1) / 2, rel=1e-6
    )
