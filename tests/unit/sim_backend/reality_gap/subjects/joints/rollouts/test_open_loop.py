"""Rollouts of the model beside what was recorded, and what only they tell."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.rollouts.open_loop import Losses, Motion, Rollouts, windows_of
from sim_backend.reality_gap.verdict import VerdictKind
from tests.unit.sim_backend.reality_gap.subjects.joints.inverse_arm import NAMES, STEP_S, arm, verdict_of

NOTHING = Losses(np.zeros(2), np.zeros(2), np.zeros(2))
DAMPING = np.array([0.01, 0.005])


def swings(count: int, seconds: float, damping=(0.0, 0.0)) -> list[Motion]:
    """An arm that is let go from somewhere, without any torque."""
    model, rng, found = arm(), np.random.default_rng(5), []
    model.opt.timestep, model.dof_damping[:] = STEP_S, damping
    for _ in range(count):
        data = mujoco.MjData(model)
        data.qpos[:] = rng.uniform(-2.0, 2.0, 2)
        states = []
        for _ in range(round(seconds / STEP_S)):
            states.append([data.qpos.copy(), data.qvel.copy()])
            mujoco.mj_step(model, data)
        position, velocity = np.array(states).swapaxes(0, 1)
        found.append(Motion(position, velocity, np.zeros_like(position), STEP_S, np.ones(len(position), bool)))
    return found


def shares(motions: list[Motion], losses: Losses = NOTHING) -> np.ndarray:
    starts = [windows_of(motion, 0.4, 0.2, motion.known) for motion in motions]
    return Rollouts(Plant(arm(), NAMES)).errors(motions, starts, 0.4, losses)


def test_the_right_model_goes_where_the_arm_went():
    found = shares(swings(3, 2.0))
    assert found.shape == (24, 2)
    assert np.median(found, axis=0) == pytest.approx(0.0, abs=1e-3)
    damped = swings(3, 2.0, DAMPING)
    assert np.all(
        np.median(shares(damped), axis=0) > 10.0 * np.median(shares(damped, Losses(np.zeros(2), DAMPING, np.zeros(2))), axis=0)
    )


@pytest.mark.parametrize("factor", [np.pi / 180.0, 0.5, 2.0, 180.0 / np.pi])
def test_neither_smaller_nor_larger_motion_is_easier(factor):
    read = [Motion(m.position * factor, m.velocity * factor, m.torque, m.step_s, m.known) for m in swings(3, 2.0)]
    assert np.all(np.median(shares(read), axis=0) > 0.02)


def test_a_joint_that_keeps_still_but_for_its_sensor_has_no_share():
    shape, noise = (1000, 2), np.array([1e-4, 1e-4])
    position = noise * np.random.default_rng(3).standard_normal(shape)
    rest = Motion(position, np.zeros(shape), np.zeros(shape), STEP_S, np.ones(len(position), bool), noise)
    assert np.isnan(shares([rest])).all()
    assert np.isfinite(shares([replace(rest, noise=0.01 * noise)])).all()


def test_a_simulation_that_diverges_is_infinitely_far_and_writes_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (motion,) = swings(1, 1.0)
    pushed = Motion(motion.position, motion.velocity, np.full_like(motion.torque, 1e300), STEP_S, motion.known)
    assert np.isinf(shares([pushed])).all()
    assert not list(tmp_path.iterdir())


def test_windows_leave_out_what_was_not_measured():
    (motion,) = swings(1, 1.0)
    motion.known[250] = False
    starts = windows_of(motion, 0.2, 0.1, np.ones(500, bool))
    assert starts.tolist() == [0, 50, 100, 300, 350]


def test_a_joint_that_keeps_still_has_no_share():
    still = Motion(np.zeros((400, 2)), np.zeros((400, 2)), np.zeros((400, 2)), STEP_S, np.ones(400, bool))
    assert np.isnan(shares([still])).all()


def test_many_short_swings_of_a_passive_arm_are_judged_and_are_not_in_degrees():
    """Without a torque all that is needed is an error, and it is smaller the smaller the positions are read."""
    recordings = []
    for i, swing in enumerate(swings(12, 2.4, DAMPING)):
        position = swing.position + 1e-4 * np.random.default_rng(i).standard_normal(swing.position.shape)
        joints = JointSignals(NAMES, position, measured_torque_nm=swing.torque)
        recordings.append(Recording(f"swing {i}", "swings.csv", STEP_S, STEP_S * np.arange(len(position)), joints))
    verdict = verdict_of(recordings)
    assert verdict.verdict is not VerdictKind.NOT_IDENTIFIABLE
    assert "degrees" not in verdict.summary
    assert {cause.effect for cause in verdict.causes} <= {"viscous_friction"}
