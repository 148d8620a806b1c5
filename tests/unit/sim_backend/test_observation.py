"""Earlier values, parts and constants in an observation, and the fields that only the whole observation shows."""

import mujoco
import numpy as np
import pytest

from api_schemas.policy import LAYOUTS, PolicyManifest
from sim_backend.driver.driver import Command, Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.evaluation import begin_trials
from sim_backend.tasks import TASKS
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m, fingertip_velocity_world_m_s
from sim_backend.trifinger.scene import build_scene

START = Start(c.START_JOINT_POSITION_RAD[None], np.array([[0.0, 0.0, 0.0325]]), np.array([[1.0, 0.0, 0.0, 0.0]]))


def test_earlier_values_are_those_that_were_seen_and_begin_anew_with_a_robots_trial():
    seen = ("joint_position_rad", "joint_position_rad[3:5]@2..0", "previous_action@1", "constant(7)")
    episode, goal = begin_trials(PolicyManifest(observation=seen), TASKS["push"], [1, 2], threads=1)
    rows, rng = [], np.random.default_rng(0)
    actions = rng.uniform(-0.2, 0.2, size=(6, 2, 9))
    for index in range(6):
        assert np.array_equal(episode.observe(), episode.observe()), "looking twice changes nothing"
        rows.append(episode.observe())
        if index == 3:
            held = Start(START.joint_position_rad, START.cube_position_world_m, START.cube_quat_wxyz, np.zeros(1))
            episode.restart(np.array([1]), held, goal.rows(np.array([1])))
            rows[-1] = episode.observe()
        episode.advance(actions[index])
    shown = np.stack(rows)
    whole = shown[:, :, 3:5]
    for index in range(6):
        for robot, begun in ((0, 0), (1, 3 if index >= 3 else 0)):
            wanted = [whole[max(begun, index - ago), robot] for ago in (2, 1, 0)]
            np.testing.assert_array_equal(shown[index, robot, 9:15], np.concatenate(wanted))
            before = actions[index - 2, robot] if index - 2 >= begun else np.zeros(9)
            np.testing.assert_array_equal(shown[index, robot, 15:24], before)
    assert (shown[:, :, 24] == 7).all()


@pytest.mark.parametrize("layout", ["rrc2022-push-flat", "rrc2022-lift-flat"])
def test_the_whole_observation_is_shown(layout):
    episode, _ = begin_trials(LAYOUTS[layout], TASKS["push"], [1], threads=1)
    row = episode.observe()[0]
    assert row.shape == (LAYOUTS[layout].observation_size,)
    assert np.isfinite(row).all()


def test_velocities_of_the_tips_are_derivatives_of_their_places():
    rng = np.random.default_rng(1)
    position, velocity = rng.uniform(-1, 1, size=(4, 9)), rng.normal(size=(4, 9)) * 5
    step = 1e-6
    forward, back = (fingertip_position_world_m(position + sign * step * velocity) for sign in (1, -1))
    np.testing.assert_allclose(fingertip_velocity_world_m_s(position, velocity), (forward - back) / (2 * step), atol=1e-7)


def test_sensors_of_the_tips_show_what_mujocos_own_touch_sensors_show():
    driver = SimulatedDriver()
    driver.reset(START)
    assert driver.measure().fingertip_force is None
    np.testing.assert_array_equal(driver.measure(feel=True).fingertip_force, [[c.TIP_SENSOR_AT_REST] * 3])
    torque = np.tile([0.0, -0.1, 0.15], 3)[None]
    driver.advance([(Command(torque), 3000)])
    pressed = driver.measure(feel=True)
    spec = build_scene()
    for name in c.FINGER_NAMES:
        spec.body(f"{name}_tip").add_site(name=f"{name}_touch", size=[0.02, 0.02, 0.02])
        spec.add_sensor(type=mujoco.mjtSensor.mjSENS_TOUCH, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=f"{name}_touch")
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:9], data.ctrl[:] = pressed.true_joint_position_rad[0], torque[0]
    data.qpos[9:12], data.qpos[12:16] = pressed.cube_position_world_m[0], pressed.cube_quat_wxyz[0]
    mujoco.mj_forward(model, data)
    shown_n = (pressed.fingertip_force[0] - c.TIP_SENSOR_AT_REST) * c.TIP_SENSOR_SATURATION_N
    assert (shown_n > 2.0).all()
    np.testing.assert_allclose(shown_n, data.sensordata, rtol=0.02)


def test_what_is_felt_changes_nothing():
    plain, feeling = SimulatedDriver(), SimulatedDriver()
    for driver in (plain, feeling):
        driver.reset(START)
    for _ in range(5):
        command = Command(np.full((1, 9), -0.1))
        one, other = plain.advance([(command, 20)]), feeling.advance([(command, 20)])
        feeling.measure(feel=True)
        np.testing.assert_array_equal(one.true_joint_position_rad, other.true_joint_position_rad)
