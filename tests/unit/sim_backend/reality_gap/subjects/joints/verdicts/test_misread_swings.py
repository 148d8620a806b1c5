"""Of what nothing drives smaller numbers leave smaller errors, right or wrong: they are no unit by that."""

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.slides import Slides
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.verdict import VerdictKind


def swings(model: mujoco.MjModel, seconds: float = 6.0) -> np.ndarray:
    """Angles of a pendulum that is let go from level, at 50 Hz in steps of a 4096th of a turn, shape (t,), rad."""
    data, steps = mujoco.MjData(model), round(0.02 / model.opt.timestep)
    data.qpos[0], found = 1.6, []
    for _ in range(round(seconds / 0.02)):
        found.append(data.qpos[0])
        mujoco.mj_step(model, data, steps)
    return np.round(np.array(found) * 4096 / (2.0 * np.pi)) * 2.0 * np.pi / 4096


def rod(inertia: float = 1.0, damping: float = 0.0) -> mujoco.MjModel:
    """A rod of 0.383 m; its inertia about its centre is told with a factor."""
    about = inertia * 0.087 * 0.383**2 / 12.0
    inertial = f'<inertial pos="0 0 -0.1915" mass="0.087" diaginertia="{about} {about} 1e-7"/>'
    return mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.0005"/><worldbody><body>'
        f'<joint name="hinge" axis="0 1 0" damping="{damping}"/>{inertial}</body></worldbody></mujoco>'
    )


@pytest.mark.parametrize(
    ("inertia", "by", "zero_rad", "said"),
    [
        (2.0, 1.0, 0.0, ""),
        (1.0, 1.0, np.pi, "the zero of hinge is half a turn away from the model's, or gravity pulls another way"),
        (1.0, 180.0 / np.pi, 0.0, "the positions of hinge are in degrees, not in rad"),
    ],
    ids=["inertia", "up", "degrees"],
)
def test_a_swing_that_nothing_drives_is_not_nearer_because_its_numbers_are_smaller(inertia, by, zero_rad, said):
    """In any smaller unit such a joint's equation leaves less, and the sine of gravity leaves nothing."""
    position = (by * swings(rod(damping=1e-4)) + zero_rad)[:, None]
    joints = JointSignals(("hinge",), position, measured_torque_nm=np.zeros_like(position))
    told = Recording("swing", "pole.csv", 0.02, 0.02 * np.arange(len(position)), joints)
    verdict = judge(study_joints(rod(inertia), [told], lambda *_: None, robot=UnknownRobot())).verdict
    assert verdict.misreads == said


def test_what_a_sensor_makes_of_no_torque_drives_nothing():
    """A current that is measured of a motor that is off is not 0: a free swing with it is as free."""
    position = swings(rod(damping=1e-4))[:, None]
    noise_nm = 1e-4 * np.random.default_rng(0).standard_normal(position.shape)
    joints = JointSignals(("hinge",), position, measured_torque_nm=noise_nm)
    told = Recording("swing", "pole.csv", 0.02, 0.02 * np.arange(len(position)), joints)
    assert judge(study_joints(rod(2.0), [told], lambda *_: None, robot=UnknownRobot())).verdict.misreads == ""


def cart_pole() -> mujoco.MjModel:
    """A cart on a rail with a pole that hangs."""
    return mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.001"/><worldbody><body><joint name="cart" type="slide" axis="1 0 0" damping="5"/>'
        '<inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/><body><joint name="pole" axis="0 1 0" damping="1e-3"/>'
        '<inertial pos="0 0 -0.2" mass="0.1" diaginertia="1e-3 1e-3 1e-4"/></body></body></worldbody>'
        '<actuator><motor joint="cart"/></actuator></mujoco>'
    )


def test_columns_of_two_joints_that_were_exchanged_are_no_unit():
    """What a motor elsewhere moves does not move less in smaller numbers."""
    model = cart_pole()
    data, found = mujoco.MjData(model), []
    for time_s in np.arange(0.0, 8.0, 0.01):
        data.ctrl[0] = 12.0 * np.sin(6.0 * time_s) + 6.0 * np.sin(11.4 * time_s) - 20.0 * data.qpos[0]
        found.append((*data.qpos, data.ctrl[0]))
        mujoco.mj_step(model, data, 10)
    cart_m, pole_rad, force_n = np.array(found).T
    slides = Slides.of(model, ("cart", "pole"))
    exchanged = np.stack([pole_rad, cart_m], axis=1)
    joints = JointSignals(("cart", "pole"), exchanged, commanded_torque_nm=np.stack([force_n, np.zeros_like(force_n)], axis=1))
    told = Recording("run", "cart.csv", 0.01, 0.01 * np.arange(len(cart_m)), joints)
    verdict = judge(
        study_joints(slides.model_as_hinges(model), [slides.as_hinges(told)], lambda *_: None, robot=UnknownRobot())
    ).verdict
    assert (verdict.verdict, verdict.misreads) == (VerdictKind.UNEXPLAINED, "")


def test_a_pendulum_that_comes_to_rest_in_air_is_not_told_in_degrees():
    """What its sensor makes of rest says nothing about units, and nor does a model that stands still."""
    xml = (
        '<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" armature="0.002" frictionloss="0.03" damping="0.012"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -0.32" size="0.016" mass="{}" contype="0" conaffinity="0"/></body></worldbody>'
        "</mujoco>"
    )
    robot, recordings, step_s = mujoco.MjModel.from_xml_string(xml.format(0.79)), [], 0.004
    robot.opt.timestep = 0.25 * step_s
    for seed, angle_rad in enumerate((2.2, -1.5, 1.0)):
        data, position = mujoco.MjData(robot), np.empty((5000, 1))
        data.qpos[0] = angle_rad
        for row in range(len(position)):
            position[row] = data.qpos
            for _ in range(4):
                data.qfrc_applied[:] = -0.006 * data.qvel * np.abs(data.qvel)
                mujoco.mj_step(robot, data)
        position = 1e-4 * np.round(1e4 * (position + 3e-5 * np.random.default_rng(seed).standard_normal(position.shape)))
        joints = JointSignals(("hinge",), position, commanded_torque_nm=np.zeros_like(position))
        recordings.append(Recording(f"swing {seed}", "swings.csv", step_s, step_s * np.arange(len(position)), joints))
    model = mujoco.MjModel.from_xml_string(xml.format(0.8))
    assert judge(study_joints(model, recordings, lambda *_: None, robot=UnknownRobot())).verdict.misreads == ""
