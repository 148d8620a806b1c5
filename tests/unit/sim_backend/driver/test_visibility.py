"""Visible faces, against MuJoCo's own rays in the compiled scene and against what geometry says."""

import mujoco
import numpy as np
import pytest

from sim_backend.driver import visibility
from sim_backend.driver.visibility import FACES, OCCLUDERS, SAMPLES, clearance_m, finger_capsules, look
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.scene import VISUAL_GROUP, compile_scene

HALF_M = c.CUBE_WIDTH_M / 2


@pytest.fixture(scope="module")
def model():
    return compile_scene()


def sight(joints, position, quat=(1.0, 0.0, 0.0, 0.0), thickness=1.0, sphere=(0.0, 0.0, 0.0, 0.0), works=(True, True, True)):
    """``look`` for n robots of which any argument may be given once for all."""
    joints = np.atleast_2d(joints).astype(float)
    n = len(joints)

    def rows(value, dtype=float):
        return np.ascontiguousarray(np.broadcast_to(np.asarray(value, dtype=dtype), (n, np.shape(value)[-1])))

    thicknesses = np.ascontiguousarray(np.broadcast_to(np.asarray(thickness, dtype=float), (n,)))
    return look(joints, rows(position), rows(quat), np.full((n, 3), HALF_M), thicknesses, rows(sphere), rows(works, bool))


def random_scene(rng):
    joints = rng.uniform(c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD)
    position = np.array([*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.0325, 0.12)])
    quat = rng.normal(size=4)
    return joints, position, quat / np.linalg.norm(quat)


def placed(model, joints, position, quat):
    data = mujoco.MjData(model)
    data.qpos[:] = np.concatenate([joints, position, quat])
    mujoco.mj_forward(model, data)
    return data


def test_capsules_are_those_of_the_scene(model):
    rng, capsules = np.random.default_rng(1), np.zeros((OCCLUDERS, 7))
    for _ in range(20):
        joints, position, quat = random_scene(rng)
        data = placed(model, joints, position, quat)
        finger_capsules(joints, capsules)
        for index, name in enumerate(f"{finger}_{link}" for finger in c.FINGER_NAMES for link in ("middle", "lower", "tip")):
            geom = model.geom(name)
            along = data.geom_xmat[geom.id].reshape(3, 3)[:, 2] * (geom.size[1] if "tip" not in name else 0.0)
            ends = np.sort([data.geom_xpos[geom.id] - along, data.geom_xpos[geom.id] + along], axis=0)
            np.testing.assert_allclose(np.sort(capsules[index, :6].reshape(2, 3), axis=0), ends, atol=1e-12)
            assert capsules[index, 6] == geom.size[0]


def samples(position, quat, face):
    """The sample points of a face in the world, shape (SAMPLES**2, 3), and its outward normal."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quat)
    axis, sign = "xyz".index(FACES[face][1]), 1.0 if FACES[face][0] == "+" else -1.0
    steps = HALF_M * ((2 * np.arange(SAMPLES) + 1) / SAMPLES - 1)
    local = np.zeros((SAMPLES, SAMPLES, 3))
    local[..., axis] = sign * HALF_M
    local[..., (axis + 1) % 3], local[..., (axis + 2) % 3] = steps[:, None], steps[None, :]
    return position + local.reshape(-1, 3) @ matrix.reshape(3, 3).T, sign * matrix.reshape(3, 3)[:, axis]


def test_faces_are_seen_where_the_rays_of_mujoco_reach_them(model):
    rng = np.random.default_rng(2)
    groups = np.ones(6, dtype=np.uint8)
    groups[VISUAL_GROUP] = 0
    compared = hidden = 0
    for _ in range(25):
        joints, position, quat = random_scene(rng)
        data = placed(model, joints, position, quat)
        size, seen, _ = sight(joints, position, quat)
        for camera, calibration in enumerate(c.CAMERAS):
            eye = np.array(calibration.position_world_m)
            for face in range(6):
                points, normal = samples(position, quat, face)
                middle = points.mean(axis=0)
                assert (size[0, camera, face] > 0) == (
                    normal @ (eye - middle) > visibility.GRAZING_COSINE * np.linalg.norm(eye - middle)
                )
                if size[0, camera, face] == 0:
                    continue
                free = 0
                for point in points:
                    hit = mujoco.mj_ray(model, data, eye, point - eye, groups, False, model.body("cube").id, None)
                    free += not 0 <= hit < 1
                compared, hidden = compared + len(points), hidden + len(points) - free
                assert seen[0, camera, face] == pytest.approx(free / len(points), abs=1e-9)
    assert compared > 2000 and hidden > 0.03 * compared


def test_without_fingers_the_cameras_see_every_face_that_looks_at_them():
    size, seen, sharp = sight(c.START_JOINT_POSITION_RAD, (0.0, 0.0, HALF_M), thickness=0.0)
    np.testing.assert_array_equal(seen, size > 0)
    np.testing.assert_array_equal(sharp, size > 0)
    looking = [{FACES[face] for face in np.flatnonzero(size[0, camera])} for camera in range(3)]
    assert looking == [{"+x", "+y", "+z"}, {"-y", "+z"}, {"-x", "+y", "+z"}]


def test_a_face_fills_the_angle_that_it_has():
    size, _, _ = sight(c.START_JOINT_POSITION_RAD, (0.0, 0.0, HALF_M), thickness=0.0)
    to_eye = np.array(c.CAMERAS[1].position_world_m) - [0.0, 0.0, c.CUBE_WIDTH_M]
    distance = np.linalg.norm(to_eye)
    assert size[0, 1, FACES.index("+z")] == pytest.approx(c.CUBE_WIDTH_M**2 * to_eye[2] / distance**3)


def test_a_dead_camera_sees_nothing_and_the_others_what_they_saw():
    _, before, _ = sight(c.START_JOINT_POSITION_RAD, (0.02, 0.0, HALF_M))
    size, seen, sharp = sight(c.START_JOINT_POSITION_RAD, (0.02, 0.0, HALF_M), works=(True, False, True))
    assert not seen[0, 1].any() and not sharp[0, 1].any() and size[0, 1].any()
    np.testing.assert_array_equal(seen[0, [0, 2]], before[0, [0, 2]])


def test_a_sphere_before_a_camera_hides_the_cube_from_it_alone():
    cube = np.array([0.0, 0.0, HALF_M])
    half_way = (np.array(c.CAMERAS[2].position_world_m) + cube) / 2
    size, seen, _ = sight(c.START_JOINT_POSITION_RAD, cube, thickness=0.0, sphere=(*half_way, 0.06))
    assert not seen[0, 2].any()
    np.testing.assert_array_equal(seen[0, :2], size[0, :2] > 0)


def test_a_cube_out_of_the_image_is_not_seen():
    size, seen, _ = sight(c.START_JOINT_POSITION_RAD, (0.3, 0.3, HALF_M), thickness=0.0)
    assert size[0].any() and not seen[0, 0].any()


def test_thicker_fingers_hide_more_and_sharp_is_never_more_than_seen():
    rng, less = np.random.default_rng(3), 0
    for _ in range(30):
        joints, position, quat = random_scene(rng)
        _, thin, _ = sight(joints, position, quat, thickness=0.5)
        _, thick, sharp = sight(joints, position, quat, thickness=1.0)
        assert (thick <= thin).all() and (sharp <= thick).all()
        less += thick.sum() < thin.sum()
    assert less > 10


def test_what_is_sharp_lies_an_edge_away_from_the_outline():
    cube, centre = (0.0, 0.0, HALF_M), (0.02, 0.03, 0.14)
    _, seen, sharp = sight(c.START_JOINT_POSITION_RAD, cube, thickness=0.0, sphere=(*centre, 0.03))
    _, farther, _ = sight(c.START_JOINT_POSITION_RAD, cube, thickness=0.0, sphere=(*centre, 0.03 + visibility.EDGE_M))
    np.testing.assert_array_equal(sharp, farther)
    assert sharp.sum() < seen.sum()


def test_something_thinner_than_a_pixel_spoils_no_more_than_its_thickness():
    cube, centre = (0.0, 0.0, HALF_M), (0.02, 0.03, 0.14)
    for radius in (0.0015, 0.0005):
        _, _, sharp = sight(c.START_JOINT_POSITION_RAD, cube, thickness=0.0, sphere=(*centre, radius))
        _, farther, _ = sight(c.START_JOINT_POSITION_RAD, cube, thickness=0.0, sphere=(*centre, 2 * radius))
        np.testing.assert_array_equal(sharp, farther)


def test_fingers_that_vanish_hide_and_spoil_nothing():
    rng, spoilt = np.random.default_rng(6), []
    scenes = [np.array(part) for part in zip(*(random_scene(rng) for _ in range(50)), strict=True)]
    for thickness in (1.0, 0.3, 0.1, 0.03, 0.01, 1e-9):
        size, seen, sharp = sight(*scenes, thickness=thickness)
        assert (sharp <= seen).all()
        spoilt.append(((size > 0) - sharp).sum())
    assert spoilt == sorted(spoilt, reverse=True)
    assert spoilt[0] > 50 and spoilt[-1] == 0


def test_a_robot_in_a_batch_sees_what_it_sees_alone():
    rng = np.random.default_rng(4)
    scenes = [random_scene(rng) for _ in range(5)]
    together = sight(*(np.array(part) for part in zip(*scenes, strict=True)), thickness=np.linspace(0, 2, 5))
    for index, scene in enumerate(scenes):
        alone = sight(*scene, thickness=np.linspace(0, 2, 5)[index])
        for batch, single in zip(together, alone, strict=True):
            assert batch[index].tobytes() == single[0].tobytes()


def test_clearance_is_the_distance_between_ray_and_surface():
    rng = np.random.default_rng(5)
    shares = np.linspace(0, 1, 201)
    for _ in range(50):
        eye, point, capsule = rng.normal(size=3), rng.normal(size=3), np.append(rng.normal(size=6), 0.1)
        ray = eye + shares[:, None] * (point - eye)
        axis = capsule[:3] + shares[:, None] * (capsule[3:6] - capsule[:3])
        sampled = np.linalg.norm(ray[:, None] - axis[None], axis=-1).min() - 0.1
        exact = clearance_m(eye, point, capsule)
        assert exact <= sampled + 1e-9 and exact == pytest.approx(sampled, abs=0.02)
