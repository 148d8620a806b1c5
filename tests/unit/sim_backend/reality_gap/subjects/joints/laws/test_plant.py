"""Inverse dynamics of a model's joints and what they depend on."""

import mujoco
import numpy as np
import pytest

from sim_backend.effects.body import link_mass
from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.subjects.joints.laws.nominal import starting_values
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.laws.trajectory import trajectory
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.scene import build_scene, compile_scene
from tests.unit.sim_backend.reality_gap.subjects.joints.driven_joints import NAMES, drive, joints_model, recording

ROWS = 12


@pytest.fixture(scope="module")
def motion():
    rng = np.random.default_rng(5)
    position = c.START_JOINT_POSITION_RAD + rng.uniform(-0.3, 0.3, (ROWS, 9))
    return position, rng.uniform(-2.0, 2.0, (ROWS, 9)), rng.uniform(-20.0, 20.0, (ROWS, 9))


@pytest.fixture(scope="module")
def plant():
    return Plant(compile_scene(), c.JOINT_NAMES)


@pytest.fixture(scope="module")
def found(plant, motion):
    return plant.derivatives(*motion)


def needed(model, motion):
    """What MuJoCo says, without contacts and limits."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data, out = mujoco.MjData(model), np.empty((ROWS, 9))
    ids = [model.joint(name) for name in c.JOINT_NAMES]
    q, v = [int(joint.qposadr[0]) for joint in ids], [int(joint.dofadr[0]) for joint in ids]
    for row in range(ROWS):
        data.qpos[q], data.qvel[v], data.qacc[v] = (part[row] for part in motion)
        mujoco.mj_inverse(model, data)
        out[row] = data.qfrc_inverse[v]
    return out


def test_torques_are_those_of_mujoco_and_the_given_model_stays_as_it_was(motion):
    model = compile_scene()
    flags, torque = int(model.opt.disableflags), Plant(model, c.JOINT_NAMES).torque_nm(*motion)
    assert int(model.opt.disableflags) == flags
    np.testing.assert_allclose(torque, needed(model, motion), atol=1e-12)


def test_all_masses_doubled_is_the_sum_of_all_images(plant, found, motion):
    model = compile_scene()
    model.body_mass *= 2.0
    model.body_inertia *= 2.0
    np.testing.assert_allclose(found.torque_nm + found.by_link_mass.sum(axis=2), needed(model, motion), atol=1e-10)


@pytest.mark.parametrize("joint", range(9))
def test_the_image_of_a_link_is_what_the_catalogue_does_to_the_specification(found, motion, joint):
    spec, factor = build_scene(), np.ones(9)
    factor[joint] = 1.3
    link_mass(spec, {"factor": factor})
    expected = found.torque_nm + 0.3 * found.by_link_mass[:, :, joint]
    np.testing.assert_allclose(expected, needed(spec.compile(), motion), atol=1e-7)


def test_gravity_and_inertia_are_linear(plant, found, motion):
    model = compile_scene()
    model.opt.gravity += [0.3, -0.2, 0.5]
    np.testing.assert_allclose(found.torque_nm + found.by_gravity @ [0.3, -0.2, 0.5], needed(model, motion), atol=1e-10)
    position, velocity, acceleration = motion
    faster = np.random.default_rng(1).uniform(-5.0, 5.0, acceleration.shape)
    expected = found.torque_nm + np.einsum("tkl,tl->tk", found.by_acceleration, faster)
    np.testing.assert_allclose(plant.torque_nm(position, velocity, acceleration + faster), expected, atol=1e-10)


def test_the_derivative_by_position_is_that_of_a_small_step_of_all_joints(plant, found, motion):
    step = 1e-5 * np.random.default_rng(2).uniform(-1.0, 1.0, motion[0].shape)
    above, below = (plant.torque_nm(motion[0] + sign * step, *motion[1:]) for sign in (1, -1))
    expected = np.einsum("tkl,tl->tk", found.by_position, step)
    np.testing.assert_allclose((above - below) / 2, expected, atol=1e-3 * np.abs(expected).max())


def test_joints_of_different_fingers_do_not_feel_each_other(plant, found):
    assert plant.groups == [[0, 3, 6], [1, 4, 7], [2, 5, 8]]
    same = np.stack([plant.same_tree(j) for j in range(9)])
    np.testing.assert_array_equal(same, np.kron(np.eye(3, dtype=bool), np.ones((3, 3), dtype=bool)))
    for image in (found.by_link_mass, found.by_position, found.by_acceleration):
        assert not image[:, ~same].any()


def test_fingers_of_different_lengths_are_grouped_and_other_joints_refused():
    link = '<body pos="0 0 1"><joint name="{}"/><geom size="0.1"/>{}</body>'
    bodies = link.format("a", link.format("b", "")) + link.format("c", "") + '<body><freejoint name="f"/><geom size="1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    plant = Plant(model, ("a", "b", "c"))
    assert plant.groups == [[0, 2], [1]]
    assert not np.isfinite(plant.range_rad).any()
    with pytest.raises(ValueError, match="f is neither a hinge nor a slide"):
        Plant(model, ("a", "f"))


def test_friction_damping_and_armature_of_the_model_are_values_that_a_study_starts_from():
    model = joints_model(frictionloss=(0.0, 0.2, 0.0))
    model.dof_damping[:], model.dof_armature[0] = 0.05, 1e-3
    plant = Plant(model, ("third", "second"))
    start = starting_values(plant, 3.0, {"coulomb_friction.torque_nm": np.array([0.1, 0.1])})
    assert set(start) == {"torque_saturation.limit_nm", "coulomb_friction.torque_nm", "viscous_friction.damping_nm_s_rad"}
    assert start["coulomb_friction.torque_nm"] == pytest.approx([0.1, 0.3])
    assert start["viscous_friction.damping_nm_s_rad"] == pytest.approx([0.05, 0.05])


def test_a_motor_whose_limit_nobody_states_has_that_of_the_data():
    plant = Plant(joints_model(), NAMES)
    stated = {"torque_saturation.limit_nm": np.array([np.nan, 2.0, np.nan])}
    assert starting_values(plant, 5.0, stated)["torque_saturation.limit_nm"].tolist() == [5.0, 2.0, 5.0]
    assert starting_values(plant, 5.0, {})["torque_saturation.limit_nm"].tolist() == [5.0, 5.0, 5.0]


def test_joints_that_hang_together_with_recorded_ones_are_known_to_rest():
    assert Plant(compile_scene(), c.JOINT_NAMES[1:2]).resting == (c.JOINT_NAMES[0], c.JOINT_NAMES[2])
    assert Plant(compile_scene(), c.JOINT_NAMES).resting == ()


def test_a_model_that_says_what_the_joints_have_leaves_no_error():
    model = joints_model(frictionloss=(0.02, 0.02, 0.02))
    model.dof_damping[:], model.dof_armature[:] = 0.05, 1e-3
    position, torque = drive(model, 3.0)
    plant = Plant(model, NAMES)
    path = trajectory(recording(position, torque), cutoff_hz=UnknownRobot.cutoff_hz)
    equations = EpisodeEquations(plant, path, 0, robot=UnknownRobot())
    given = starting_values(plant, 10.0, {})
    counted = equations.valid_mechanics
    assert np.abs(equations.torque_error(JointState(3, given))[counted]).mean() < 1e-3
    without = JointState(3, given | {"viscous_friction.damping_nm_s_rad": np.zeros(3)})
    assert np.abs(equations.torque_error(without)[counted]).mean() > 0.02


LINKS = """<mujoco><compiler angle="radian"/><worldbody>
<body><joint name="a" axis="0 1 0"/><inertial pos="0.02 0 {first}" mass="1" diaginertia="0.01 0.01 0.004"/>
<body pos="0 0 -0.3"><joint name="b" axis="1 0 0"/><inertial pos="0 0.01 -0.1" mass="0.5" diaginertia="{second} 0.003 0.001"/>
</body></body></worldbody></mujoco>"""


def links(first=-0.12, second=0.003) -> Plant:
    return Plant(mujoco.MjModel.from_xml_string(LINKS.format(first=first, second=second)), ("a", "b"))


def test_what_torques_owe_to_inertia_and_centres_of_links():
    rng = np.random.default_rng(2)
    motion = (rng.uniform(-1, 1, (ROWS, 2)), rng.uniform(-2, 2, (ROWS, 2)), rng.uniform(-9, 9, (ROWS, 2)))
    found, base = links().link_derivatives(*motion), links().torque_nm(*motion)
    lower = (links(first=-0.1201).torque_nm(*motion) - links(first=-0.1199).torque_nm(*motion)) / -2e-4
    np.testing.assert_allclose(found.by_centre[:, :, 0, 2], lower, atol=2e-3)
    # all three moments are off together, about an axis where only the first one counts
    alone = (motion[0] * [0, 1], motion[1] * [0, 1], motion[2] * [0, 1])
    larger = links(second=0.0033).torque_nm(*alone) - links().torque_nm(*alone)
    np.testing.assert_allclose(0.1 * links().link_derivatives(*alone).by_inertia[:, 1, 1], larger[:, 1], atol=1e-9)
    assert found.by_inertia.shape == (ROWS, 2, 2) and np.abs(base).max() > 1.0
    np.testing.assert_allclose(links().centre_distance_m, [np.hypot(0.02, 0.12), np.hypot(0.01, 0.1)])
