"""Each effect of cube and contacts does what physics says it must."""

import mujoco
import numpy as np
import pytest

from sim_backend.driver.robot_model import robot_spec
from sim_backend.effects.physics import Physics
from sim_backend.trifinger.kinematics import fingertip_position_world_m
from tests.unit.sim_backend.effects.rig import MID_RAD, c, rig, run, start_of

TOUCHING = {"tip on cube": ("finger0_tip", "cube"), "cube on table": ("table", "cube"), "tip on table": ("table", "finger0_tip")}


def frictions(values: dict) -> dict[str, float]:
    """Sliding friction of each kind of contact, from a scene in which it is made."""
    model = robot_spec(Physics.of(1, values), physics_step_s=0.001).compile()
    lower_rad = np.linspace(-2.0, -0.8, 4001)
    heights_m = fingertip_position_world_m(np.stack([[0.0, 0.6, angle, *MID_RAD[3:]] for angle in lower_rad]))[:, 2]
    down = np.array([0.0, 0.6, lower_rad[np.abs(heights_m - c.TIP_RADIUS_M + 2e-4).argmin()], *MID_RAD[3:]])
    tip_m = fingertip_position_world_m(MID_RAD)[:3]
    scenes = {
        "tip on cube": (MID_RAD, tip_m - [0.0, 0.0, c.TIP_RADIUS_M + c.CUBE_WIDTH_M / 2 - 2e-4]),
        "cube on table": (MID_RAD, np.array([0.0, 0.0, c.CUBE_REST_HEIGHT_M - 1e-4])),
        "tip on table": (down, np.array([-0.1, -0.1, 0.2])),
    }
    return {name: _friction(model, *state, TOUCHING[name]) for name, state in scenes.items()}


def _friction(model: mujoco.MjModel, joints_rad: np.ndarray, cube_m: np.ndarray, pair: tuple[str, str]) -> float:
    data = mujoco.MjData(model)
    data.qpos[:9], data.qpos[9:12], data.qpos[12] = joints_rad, cube_m, 1.0
    mujoco.mj_forward(model, data)
    found = {frozenset((model.geom(each.geom1).name, model.geom(each.geom2).name)): each.friction[0] for each in data.contact}
    return float(found[frozenset(pair)])


@pytest.mark.parametrize(
    ("effect", "changed"),
    [("fingertip_friction", "tip on cube"), ("table_friction", "cube on table"), ("finger_table_friction", "tip on table")],
)
def test_each_friction_is_that_of_its_own_contacts_only(effect: str, changed: str):
    nominal, found = frictions({}), frictions({f"{effect}.coefficient": 0.37})
    assert nominal == {"tip on cube": c.CUBE_FRICTION, "cube on table": c.CUBE_FRICTION, "tip on table": c.FINGER_FRICTION}
    assert found == pytest.approx(nominal | {changed: 0.37})


def test_the_cube_weighs_what_it_should():
    """The same pushes on a falling cube of twice the mass move it half as far."""
    values = {"cube_pushes.force_n": 0.5, "cube_pushes.probability": 1.0}
    far = [
        run(rig(values | {"cube_mass.factor": factor}, start=start_of(cube=(0, 0, 0.3))), 0.0, 100).cube_position_world_m[0, -1]
        for factor in (1.0, 2.0)
    ]
    assert far[0][:2] == pytest.approx(2 * far[1][:2], rel=1e-6)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_the_cube_rests_as_high_as_it_is(factor: float):
    driver = rig({"cube_size.factor": factor})
    height_m = driver.rest_height_m(np.array([[1.0, 0.0, 0.0, 0.0]]))
    assert height_m == pytest.approx([c.CUBE_REST_HEIGHT_M * factor])
    driver.reset(start_of(cube=(0.0, 0.0, float(height_m[0]))))
    segment = run(driver, 0.0, 500)
    assert segment.cube_position_world_m[0, -1, 2] == pytest.approx(c.CUBE_REST_HEIGHT_M * factor, abs=3e-4)


def test_the_softer_a_contact_the_deeper_the_cube_sinks():
    def sunk_m(time_s: float) -> float:
        segment = run(rig({"contact_stiffness.time_constant_s": time_s}), 0.0, 2000)
        return c.CUBE_REST_HEIGHT_M - float(segment.cube_position_world_m[0, -1, 2])

    assert sunk_m(0.1) > 2 * sunk_m(0.05) > 2 * sunk_m(0.02) > 0


def test_pushes_come_as_often_and_as_strong_as_stated():
    force_n, probability, duration_s, robots = 0.3, 0.25, 0.02, 300
    values = {
        "cube_pushes.force_n": force_n,
        "cube_pushes.probability": probability,
        "cube_pushes.duration_s": duration_s,
        "gravity.offset_m_s2": [0.0, 0.0, 9.81],
    }
    segment = run(rig(values, robots, start=start_of(robots, cube=(0.0, 0.0, 0.3))), 0.0, 201)
    acceleration = np.diff(segment.cube_position_world_m, n=2, axis=1) / 1e-6
    force = (c.CUBE_MASS_KG * acceleration).reshape(robots, -1, 3)[:, :180].reshape(robots, 9, 20, 3)
    pushed = np.abs(force[:, :, 5]).max(axis=-1) > 1e-6
    blocks = pushed.size
    assert pushed.mean() == pytest.approx(probability, abs=4 * np.sqrt(probability * (1 - probability) / blocks))
    strong = force[:, :, 5][pushed]
    assert strong.std() == pytest.approx(force_n, rel=4 / np.sqrt(2 * strong.size))
