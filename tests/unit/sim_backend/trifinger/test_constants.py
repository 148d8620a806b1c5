"""The compiled model has the numbers of constants.py."""

import mujoco
import numpy as np
import pytest

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.scene import build_scene, compile_scene


@pytest.fixture(scope="module")
def model():
    return compile_scene()


def test_joints_and_actuators_are_in_robot_order(model):
    assert tuple(model.joint(j).name for j in range(9)) == c.JOINT_NAMES
    assert tuple(model.actuator(a).name for a in range(9)) == c.JOINT_NAMES
    assert model.joint(9).name == "cube"
    assert model.jnt_range[:9, 0] == pytest.approx(c.SOFT_LIMIT_LOWER_RAD)
    assert model.jnt_range[:9, 1] == pytest.approx(c.SOFT_LIMIT_UPPER_RAD)


def test_masses_and_geometry(model):
    assert model.body("cube").mass[0] == c.CUBE_MASS_KG
    assert model.body("cube").inertia == pytest.approx([c.CUBE_INERTIA_KG_M2] * 3)
    assert model.geom("cube").size == pytest.approx([c.CUBE_WIDTH_M / 2] * 3)
    assert sum(model.body(f"finger0_{link.name}").mass[0] for link in c.LINKS) == pytest.approx(0.60341)
    assert model.geom("finger120_tip").size[0] == c.TIP_RADIUS_M
    assert model.opt.timestep == c.PHYSICS_STEP_S


def test_max_torque_is_the_documented_one():
    assert pytest.approx(0.396) == c.MAX_TORQUE_NM
    assert pytest.approx(0.1387, abs=1e-4) == c.MAX_CUBE_CENTRE_DISTANCE_M


def test_only_the_cube_touches_the_table_at_the_start(model):
    data = mujoco.MjData(model)
    data.qpos[:9] = c.START_JOINT_POSITION_RAD
    mujoco.mj_forward(model, data)
    touching = {tuple(sorted((model.geom(x.geom1).name, model.geom(x.geom2).name))) for x in data.contact}
    assert touching == {("cube", "table")}


@pytest.mark.parametrize("height_m, radius_m", [(0.01, 0.1948), (0.06, 0.212), (0.1, 0.235), (0.16, 0.270)])
def test_wall_follows_the_measured_profile(model, height_m, radius_m):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    group = np.array([1, 0, 0, 0, 0, 0], np.uint8)
    hit = np.zeros(1, np.int32)
    distance = mujoco.mj_ray(model, data, np.array([0.1, 0.0, height_m]), np.array([1.0, 0.0, 0.0]), group, 1, -1, hit)
    assert model.geom(hit[0]).name.startswith("wall")
    assert 0.1 + distance == pytest.approx(radius_m, abs=0.005)  # the facts' profile is a cone to within 5 mm


def test_cameras_look_at_the_arena(model):
    for camera in c.CAMERAS:
        compiled = model.camera(camera.name)
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, compiled.quat)
        axis = -matrix.reshape(3, 3)[:, 2]
        assert axis == pytest.approx(np.array(camera.optical_axis_world) / np.linalg.norm(camera.optical_axis_world), abs=1e-6)
        assert model.cam_resolution[compiled.id] == pytest.approx(c.CAMERA_RESOLUTION_PX)


def test_mjcf_text_compiles_to_the_same_model(model):
    again = mujoco.MjModel.from_xml_string(build_scene().to_xml())
    assert again.body_mass == pytest.approx(model.body_mass)
    assert again.geom_size == pytest.approx(model.geom_size)
