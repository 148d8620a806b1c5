"""Walls, corners and edges meet what touches them in this form of the scene as they did in that of 0.1.0."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.scene import build_scene

FIRST = Path(__file__).parent.parent / "kept" / "v0_1_0" / "scene.xml"
STEPS = 400
CLOSE_M = 2e-4
"""Numbers in MJCF have six digits, and a bounce makes differences larger."""


@pytest.fixture(scope="module")
def forms() -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """The form of 0.1.0 and that of now, both read from their MJCF."""
    spec = build_scene()
    spec.compile()
    return mujoco.MjModel.from_xml_path(str(FIRST)), mujoco.MjModel.from_xml_string(spec.to_xml())


def about(axis: list[float], angle_rad: float) -> list[float]:
    return [np.cos(angle_rad / 2), *(np.sin(angle_rad / 2) * np.array(axis) / np.linalg.norm(axis))]


def thrown(model, position_m, quat, velocity) -> tuple[np.ndarray, set[str]]:
    """Where the cube goes, and the arena's geoms that it touches."""
    data, way, touched = mujoco.MjData(model), [], set()
    data.qpos[:9] = c.START_JOINT_POSITION_RAD
    data.qpos[9:16] = [*position_m, *quat]
    data.qvel[9:15] = velocity
    for _ in range(STEPS):
        data.ctrl[:] = data.qfrc_bias[:9] - 5.0 * (data.qpos[:9] - c.START_JOINT_POSITION_RAD) - 0.3 * data.qvel[:9]
        mujoco.mj_step(model, data)
        way.append(data.qpos[9:16].copy())
        touched |= {model.geom(each.geom1).name for each in data.contact} | {model.geom(each.geom2).name for each in data.contact}
    return np.array(way), {name for name in touched if name.startswith(("wall", "table"))}


THROWS = {
    "slides into the ring": ([0.12, 0.0, 0.0326], [1, 0, 0, 0], [1.6, 0, 0, 0, 0, 0]),
    "slides into the ring between two boxes": ([0.11, 0.04, 0.0326], about([0, 0, 1], 0.4), [1.5, 0.55, 0, 0, 0, 0]),
    "flies against the cone": ([-0.08, 0.05, 0.11], about([1, 1, 0], 0.5), [-1.0, 0.7, 0.3, 0, 3, 0]),
    "falls on an edge": ([0.0, 0.05, 0.06], about([1, 0, 0], np.pi / 4), [0, 0, 0, 0, 0, 0]),
    "falls on a corner at the wall": ([0.13, -0.05, 0.08], about([1, 1, 0.3], 0.9), [0.3, -0.1, 0, 0, 0, 1]),
}


@pytest.mark.parametrize("name", THROWS)
def test_a_thrown_cube_goes_the_same_way(forms, name):
    (before, touched_before), (now, touched_now) = (thrown(model, *THROWS[name]) for model in forms)
    assert touched_now == touched_before
    assert any(each.startswith("wall") for each in touched_now) or "edge" in name
    assert np.abs(now[:, :3] - before[:, :3]).max() < CLOSE_M


@pytest.mark.parametrize("finger", [0, 1, 2])
def test_a_finger_presses_on_the_wall_with_the_same_force(forms, finger):
    """The tip is driven outwards until it presses on the wall with 0.25 N m at each joint."""
    forces, geoms = [], []
    for model in forms:
        data = mujoco.MjData(model)
        data.qpos[:9], data.qpos[9:16] = c.START_JOINT_POSITION_RAD, [0.0, 0.0, 0.0325, 1, 0, 0, 0]
        push = np.zeros(9)
        push[3 * finger : 3 * finger + 3] = [0.0, 0.25, 0.25]
        for _ in range(3 * STEPS):
            data.ctrl[:] = np.where(push != 0.0, push - 0.09 * data.qvel[:9], -5.0 * (data.qpos[:9] - c.START_JOINT_POSITION_RAD))
            data.ctrl[:] -= 0.1 * data.qvel[:9]
            mujoco.mj_step(model, data)
        found, total = np.zeros(6), 0.0
        names = set()
        for index, each in enumerate(data.contact):
            pair = {model.geom(each.geom1).name, model.geom(each.geom2).name}
            if any(one.startswith("wall") for one in pair):
                mujoco.mj_contactForce(model, data, index, found)
                total += found[0]
                names |= pair
        forces.append(total)
        geoms.append(names)
    assert geoms[0] == geoms[1]
    assert geoms[0], "the tip reaches the wall"
    assert forces[0] > 0.5
    assert forces[1] == pytest.approx(forces[0], rel=1e-3)
