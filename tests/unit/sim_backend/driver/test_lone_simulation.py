"""A simulation alone does what MuJoCo's own batch does with one, to the bit."""

import mujoco
import numpy as np
import pytest

from sim_backend.driver import native_control
from sim_backend.driver.lone_simulation import LoneSimulation
from sim_backend.driver.physics_backend import CpuBatch
from sim_backend.driver.physics_batch import PhysicsBatch
from sim_backend.driver.robot_model import compile_robot
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects import record as r
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.tasks.task import draw_start
from sim_backend.trifinger import constants as c

STEPS = 300


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    native_control.install()
    return compile_robot(Physics.nominal(), physics_step_s=c.PHYSICS_STEP_S)


def both(model: mujoco.MjModel) -> tuple[LoneSimulation, CpuBatch]:
    """A simulation alone and a batch of one, both as a trial begins, with the safety pipeline."""
    pair = LoneSimulation(model), CpuBatch(model, 1, nthread=1)
    for batch in pair:
        begin(batch)
    return pair


def begin(batch: PhysicsBatch) -> None:
    batch.reset(ids=np.arange(1), stage=mujoco.mjtStage.mjSTAGE_NONE)
    batch.bind("qpos")[0, :9] = c.START_JOINT_POSITION_RAD
    batch.bind("qpos")[0, 9:16] = [0.02, 0.0, 0.05, 1.0, 0.0, 0.0, 0.0]
    batch.forward(ids=np.arange(1))
    batch.bind("userdata")[0, [r.SAFETY_ON, r.STEP_S]] = 1.0, c.PHYSICS_STEP_S
    batch.bind("userdata")[0, r.POSITION_TARGET : r.POSITION_TARGET + 9] = np.nan


def torques(seed: int) -> np.ndarray:
    """Torques that change every 20 ms, shape (1, STEPS, 9), N m."""
    return np.repeat(np.random.default_rng(seed).uniform(-0.3, 0.3, (1, STEPS // 20, 9)), 20, axis=1)


def test_the_same_bits_as_a_batch_of_one(model: mujoco.MjModel) -> None:
    alone, batch = both(model)
    for seed in range(3):
        ours, theirs = (each.advance(torques(seed), report=True) for each in (alone, batch))
        for name in ("qpos", "qvel", "ctrl", "report"):
            assert np.array_equal(getattr(ours, name), getattr(theirs, name)), name
    assert alone.bind("qpos")[0, 11] < 0.04  # the cube has fallen onto the table, so that there were contacts
    for name in ("time", "qpos", "qvel", "act", "history", "qacc_warmstart", "ctrl", "qfrc_applied", "userdata"):
        assert np.array_equal(alone.bind(name).ravel(), batch.bind(name).ravel(), equal_nan=True), name


def test_what_nobody_asked_for_is_not_reported(model: mujoco.MjModel) -> None:
    assert both(model)[0].advance(torques(0), report=False).report is None


def test_torques_may_be_a_view_of_others(model: mujoco.MjModel) -> None:
    alone, batch = both(model)
    few = np.linspace(-0.2, 0.2, 18).reshape(1, 1, 18)
    view = np.broadcast_to(few, (1, STEPS, 18))[:, :, ::2]
    assert np.array_equal(alone.advance(view, report=False).ctrl, batch.advance(view, report=False).ctrl)


def test_an_unstable_simulation_stops_and_counts_a_warning(model: mujoco.MjModel) -> None:
    pair = both(model)
    for each in pair:
        each.bind("qvel")[0, 0] = 1e12
        rows = each.advance(torques(0), report=True)
        assert each.warning.any()
        assert np.array_equal(rows.qpos[0, 1:], np.repeat(rows.qpos[0, 1:2], STEPS - 1, axis=0))
        begin(each)
        assert not each.warning.any()
    ours, theirs = (each.advance(torques(1), report=True) for each in pair)
    assert np.array_equal(ours.qpos, theirs.qpos)


def test_a_model_of_other_sizes_is_refused(model: mujoco.MjModel) -> None:
    other = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>")
    with pytest.raises(ValueError, match="another nq, nv"):
        LoneSimulation(model).set_models([other])


def test_a_copy_of_the_data_may_be_changed(model: mujoco.MjModel) -> None:
    alone, batch = both(model)
    copied = alone.get_data(0)
    copied.qpos[:] = 1.0
    copied.userdata[:] = 5.0
    ours, theirs = (each.advance(torques(2), report=True) for each in (alone, batch))
    assert np.array_equal(ours.qpos, theirs.qpos)


def test_a_robot_with_effects_goes_on_from_its_state_with_the_same_bits() -> None:
    drawn = load_ranges("real").draw(np.random.default_rng(5), 1)
    first, second = SimulatedDriver(physics=drawn), SimulatedDriver(physics=drawn)
    first.reset(draw_start(np.random.default_rng(3)))
    first.advance_torques(torques(3))
    second.restore(first.state())
    after = [driver.advance_torques(torques(4)) for driver in (first, second)]
    assert np.array_equal(after[0].joint_position_rad, after[1].joint_position_rad)
    assert np.array_equal(after[0].effective_torque_nm, after[1].effective_torque_nm)
