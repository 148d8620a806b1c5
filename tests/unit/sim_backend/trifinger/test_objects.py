"""Objects weigh what their volume says, rest on the table and can be held."""

import mujoco
import numpy as np
import pytest

from api_schemas.physics import LARGEST_SCALE, SMALLEST_SCALE, ObjectName
from sim_backend.effects.contact import cube_size
from sim_backend.tasks.task import draw_face_up_quat_wxyz
from sim_backend.trifinger import constants as c
from sim_backend.trifinger import viewer_scene
from sim_backend.trifinger.kinematics import joint_position_rad
from sim_backend.trifinger.objects import (
    CUBE,
    DENSITY_KG_M3,
    MAX_SCALE,
    MIN_SCALE,
    OBJECT_NAMES,
    Kind,
    corners_m,
    resting_height_m,
    shape_of,
)
from sim_backend.trifinger.scene import build_scene, compile_scene

every_object = pytest.mark.parametrize(
    ("name", "scale"), [(name, scale) for name in OBJECT_NAMES for scale in (MIN_SCALE, 1.0, MAX_SCALE)]
)


def test_names_and_scales_are_those_of_the_job():
    assert tuple(name.value for name in ObjectName) == OBJECT_NAMES
    assert (SMALLEST_SCALE, LARGEST_SCALE) == (MIN_SCALE, MAX_SCALE)


def test_the_cube_is_the_nominal_one():
    assert shape_of("cube") == CUBE
    assert compile_scene(shape=CUBE).body("cube").mass[0] == c.CUBE_MASS_KG
    assert build_scene(shape=CUBE).to_xml() == build_scene().to_xml()


@every_object
def test_mass_and_inertia_are_those_of_a_solid_of_the_cubes_density(name, scale):
    shape = shape_of(name, scale)
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body()
    kinds = {Kind.BOX: mujoco.mjtGeom.mjGEOM_BOX, Kind.SPHERE: mujoco.mjtGeom.mjGEOM_SPHERE}
    if shape.kind in kinds:
        body.add_geom(type=kinds[shape.kind], size=np.array(shape.size_m) / 2, density=DENSITY_KG_M3)
    else:
        spec.add_mesh(name="solid", uservert=corners_m(shape).ravel())
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="solid", density=DENSITY_KG_M3)
    body.add_freejoint()
    solid = spec.compile()
    assert shape.mass_kg == pytest.approx(solid.body_mass[1], rel=1e-6)
    assert sorted(shape.inertia_kg_m2) == pytest.approx(sorted(solid.body_inertia[1]), rel=1e-4)
    assert compile_scene(shape=shape).body("cube").mass[0] == pytest.approx(shape.mass_kg)


@every_object
def test_it_rests_on_the_table_whatever_face_is_up(name, scale):
    shape = shape_of(name, scale)
    model = compile_scene(shape=shape)
    data = mujoco.MjData(model)
    for seed in range(3):
        quat = draw_face_up_quat_wxyz(np.random.default_rng(seed))
        start = np.array([0.1, 0.0, resting_height_m(shape, quat)])
        mujoco.mj_resetData(model, data)
        data.qpos[:9], data.qpos[9:12], data.qpos[12:] = c.START_JOINT_POSITION_RAD, start, quat
        for _ in range(1000):
            data.ctrl[:] = 9 * (c.START_JOINT_POSITION_RAD - data.qpos[:9]) - 0.1 * data.qvel[:9]
            mujoco.mj_step(model, data)
        assert data.qpos[9:12] == pytest.approx(start, abs=5e-4)
        assert abs(np.dot(data.qpos[12:], quat)) > 0.9999


@every_object
def test_three_fingers_can_hold_it(name, scale):
    shape = shape_of(name, scale)
    model = compile_scene(shape=shape)
    data = mujoco.MjData(model)
    angles, middle = np.deg2rad([0.0, -90.0, 180.0]), np.array([0.0, 0.0, 0.09])
    sides = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    touch = sides * (np.array(shape.size_m)[[0, 1, 0]] / 2 + c.TIP_RADIUS_M)[:, None]
    squeeze, beside = touch - sides * [[0.015], [0.004], [0.015]], touch + 0.01 * sides
    data.qpos[:9] = joint_position_rad((middle + beside).ravel())
    data.qpos[9:12] = middle
    target = joint_position_rad((middle + squeeze).ravel())
    gravity, model.opt.gravity[:] = model.opt.gravity.copy(), 0.0
    for step in range(2500):
        if step == 500:
            model.opt.gravity[2] = gravity[2]
        weight = data.qfrc_bias[:9]  # so that the position controller has only the grip to hold
        data.ctrl[:] = np.clip(weight + 20 * (target - data.qpos[:9]) - 0.2 * data.qvel[:9], -c.MAX_TORQUE_NM, c.MAX_TORQUE_NM)
        mujoco.mj_step(model, data)
    assert data.qpos[11] > middle[2] - 0.01


@pytest.mark.parametrize("name", OBJECT_NAMES)
def test_a_larger_one_of_the_same_mass_is_what_the_effect_makes(name):
    spec = build_scene(shape=shape_of(name))
    cube_size(spec, {"factor": 1.1})
    model, larger = spec.compile(), compile_scene(shape=shape_of(name, 1.1))
    assert model.geom_rbound[model.geom("cube").id] == pytest.approx(larger.geom_rbound[larger.geom("cube").id])
    assert model.geom_aabb[model.geom("cube").id] == pytest.approx(larger.geom_aabb[larger.geom("cube").id], abs=1e-6)


def test_heights_of_the_cuboids_faces():
    shape = shape_of("cuboid")
    quarter = np.sqrt(0.5)
    quats = np.array([[1, 0, 0, 0], [quarter, quarter, 0, 0], [quarter, 0, quarter, 0]])
    x, y, z = shape.size_m
    assert resting_height_m(shape, quats) == pytest.approx([z / 2, y / 2, x / 2])
    assert shape.rest_height_m == z / 2


@pytest.mark.parametrize("name", OBJECT_NAMES)
def test_the_viewer_draws_it(name):
    shape = shape_of(name)
    assert viewer_scene.true_scene(shape) != viewer_scene.true_scene(shape_of(name, 1.2))
    assert viewer_scene.measured_scene(None, None, None, shape)


def test_errors_name_the_choices():
    with pytest.raises(ValueError, match="cuboid, sphere"):
        shape_of("die")
    with pytest.raises(ValueError, match=r"between 0\.6 and 1\.2"):
        shape_of("cube", 2.0)
