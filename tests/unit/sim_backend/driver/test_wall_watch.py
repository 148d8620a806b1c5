"""Parts of the wall that are not looked at change nothing, to the bit, and are off wherever nothing is near."""

import mujoco
import numpy as np
import pytest

from sim_backend.driver import wall_watch
from sim_backend.driver.driver import Segment, Start
from sim_backend.driver.robot_model import compile_robot
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import OBJECT_NAMES, shape_of
from sim_backend.trifinger.scene import ARENA_BITS, WALL_PARTS

STEPS, TRIALS = 300, 8
WITHIN_M = 0.01


def starts(seed: int) -> list[tuple[Start, np.ndarray]]:
    """Objects thrown outwards and fingers that hit about, so that the wall is touched everywhere."""
    rng, found = np.random.default_rng(seed), []
    for index in range(TRIALS):
        direction, quat = 2 * np.pi * (index + rng.uniform()) / TRIALS, rng.normal(size=4)
        outwards = np.array([np.cos(direction), np.sin(direction), 0.0])
        start = Start(
            joint_position_rad=c.START_JOINT_POSITION_RAD[None] + rng.uniform(-0.3, 0.3, (1, 9)),
            cube_position_world_m=(0.1 * outwards + [0.0, 0.0, 0.05 + 0.05 * rng.uniform()])[None],
            cube_quat_wxyz=(quat / np.linalg.norm(quat))[None],
            cube_velocity=np.concatenate([rng.uniform(0.5, 2.5) * outwards, rng.uniform(-20, 20, 3)])[None],
        )
        found.append((start, np.repeat(rng.uniform(-0.36, 0.36, (1, 6, 9)), STEPS // 6, axis=1)))
    return found


def of_two(start: Start) -> Start:
    return Start(*(np.repeat(value, 2, axis=0) for value in _poses(start)), cube_velocity=_twice(start.cube_velocity))


def _poses(start: Start) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return start.joint_position_rad, start.cube_position_world_m, start.cube_quat_wxyz


def _twice(values: np.ndarray | None) -> np.ndarray | None:
    return None if values is None else np.repeat(values, 2, axis=0)


@pytest.mark.parametrize(("object_name", "physics"), [*((name, "nominal") for name in OBJECT_NAMES), ("cube", "real")])
def test_a_robot_alone_goes_where_one_in_a_batch_goes(object_name, physics):
    """In a batch nothing is switched off."""
    shape, drawn = shape_of(object_name), _drawn(physics)
    alone = SimulatedDriver(shape=shape, physics=drawn)
    batch = SimulatedDriver(robots=2, shape=shape, physics=Physics.stack([drawn, drawn]))
    touched = 0
    for start, torque_nm in starts(5):
        alone.reset(start)
        batch.reset(of_two(start))
        one, both = alone.advance_torques(torque_nm.copy()), batch.advance_torques(np.repeat(torque_nm, 2, axis=0))
        for name in set(one._fields) - {"first_step"}:
            np.testing.assert_array_equal(getattr(one, name)[0], getattr(both, name)[0], err_msg=name)
        touched += _was_at_wall(one)
    assert touched > TRIALS // 2


def _drawn(physics: str) -> Physics:
    return Physics.nominal(1) if physics == "nominal" else load_ranges(physics).draw(np.random.default_rng(1), 1)


def _was_at_wall(segment: Segment) -> bool:
    return bool(np.linalg.norm(segment.cube_position_world_m[0, :, :2], axis=1).max() > c.WALL_PROFILE_M[0][0] - 0.05)


def test_what_is_left_out_is_out_of_reach():
    """No geom is nearer to a part that is off than the look allows, by MuJoCo's own distances."""
    model = compile_robot(Physics.nominal(), physics_step_s=c.PHYSICS_STEP_S)
    data, rng, bits = mujoco.MjData(model), np.random.default_rng(3), np.empty(WALL_PARTS, np.int32)
    wall = [g for g in range(model.ngeom) if model.geom_bodyid[g] in range(1, 1 + WALL_PARTS)]
    first, off = 1 + max(wall), 0
    for _ in range(60):
        data.qpos[:9] = rng.uniform(c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD)
        data.qpos[9:12] = *rng.uniform(-0.2, 0.2, 2), rng.uniform(0.0, 0.2)
        data.qpos[12:16] = rng.normal(size=4)
        mujoco.mj_kinematics(model, data)
        positions, turns = data.geom_xpos, data.geom_xmat
        kinds, sizes, radii = model.geom_type, model.geom_size, model.geom_rbound
        wall_watch.look(first, kinds, model.geom_contype, sizes, radii, positions, turns, WITHIN_M, bits)
        looked = [g for g in range(first, model.ngeom) if model.geom_contype[g] & wall_watch.TOUCHING_BITS]
        for part in np.flatnonzero(bits == 0):
            off += 1
            boxes = [g for g in wall if model.geom_bodyid[g] == 1 + part]
            for geom in looked:
                nearest = min(mujoco.mj_geomDistance(model, data, geom, box, 2 * WITHIN_M, None) for box in boxes)
                assert nearest > WITHIN_M
    assert off > 60


def test_nothing_is_looked_at_where_nothing_is_near():
    driver = SimulatedDriver()
    assert driver._models is not None
    upright = np.array([[1.0, 0.0, 0.0, 0.0]])
    driver.reset(Start(c.START_JOINT_POSITION_RAD[None], np.array([[0.16, 0.0, 0.0325]]), upright))
    walls = driver._models[0].body_contype[1 : 1 + WALL_PARTS]
    driver.advance_torques(np.zeros((1, 1, 9)))
    assert 0 < np.count_nonzero(walls == ARENA_BITS) < WALL_PARTS
    middle = Start(c.START_JOINT_POSITION_RAD[None], np.array([[0.0, 0.0, 0.0325]]), upright)
    driver.reset(middle)
    assert (walls == ARENA_BITS).all(), "the last trial's end says nothing about this one's begin"
    driver.advance_torques(np.zeros((1, 1, 9)))
    assert not walls.any()
