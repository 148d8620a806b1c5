"""Forward simulation of joints over windows of a recording: does the model go where the robot went?

Equations along a motion compare torques, and whatever makes motions or torques smaller makes their errors smaller, right or
wrong. A rollout starts where the robot was, is driven by the same torques, and its error is a share of how far the robot moved.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from mujoco.rollout import rollout

from sim_backend.driver.native_control import silence_warnings
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant

_LONGEST_STEP_S = 0.002
_STILL = 5.0
"""Times the noise of its positions that a joint seems to move, at most, while it keeps still."""
_HELD_KG_M2 = 1e6
"""Armature of joints that were not recorded: they rest."""
_APPLIED = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)


@dataclass(frozen=True)
class Motion:
    """What a recording says of k joints, at its own rate.

    Attributes:
        position, velocity, torque: shape (s, k); rad, rad/s and N m.
        step_s: between samples.
        known: samples in which all of it was measured, shape (s,).
        noise: of the positions, rad, shape (k,) or ().
    """

    position: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray
    step_s: float
    known: np.ndarray
    noise: np.ndarray = field(default_factory=lambda: np.zeros(()))


@dataclass(frozen=True)
class Losses:
    """Friction and a constant torque of each joint, shapes (k,): Coulomb friction and offset in N m, damping in N m s/rad."""

    coulomb_nm: np.ndarray
    damping_nm_s_rad: np.ndarray
    offset_nm: np.ndarray


class Rollouts:
    """Simulates windows of recorded motions, without contacts, ends and the model's own actuators.

    Args:
        plant: whose model it is; what the model has of friction and damping is replaced by what is asked.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        silence_warnings()

    def errors(self, motions: Sequence[Motion], starts: Sequence[np.ndarray], window_s: float, losses: Losses) -> np.ndarray:
        """How far each joint is from where it was, as a share of how far it moved, in each window; shape (w, k).

        Both are root mean squares over the window. Where a simulation diverges the share is infinite, where a joint keeps still
        in a window, but for what its sensor makes of that, it is NaN.

        Args:
            motions: recordings.
            starts: of each motion's windows, indices of samples.
            window_s: length of the windows.
            losses: beside the model's masses.
        """
        found = [self._errors_of(motion, begin, window_s, losses) for motion, begin in zip(motions, starts, strict=True)]
        return np.concatenate([np.zeros((0, self._plant.joints)), *found])

    def _errors_of(self, motion: Motion, starts: np.ndarray, window_s: float, losses: Losses) -> np.ndarray:
        samples = round(window_s / motion.step_s)
        if not len(starts):
            return np.zeros((0, self._plant.joints))
        model = self._model(motion.step_s, losses)
        substeps = round(motion.step_s / model.opt.timestep)
        rows = starts[:, None] + np.arange(samples)
        torque = np.zeros((len(starts), samples * substeps, model.nv))
        torque[:, :, self._plant.velocities] = np.repeat(motion.torque[rows] + losses.offset_nm, substeps, axis=1)
        state = np.zeros((len(starts), 1 + model.nq + model.nv))
        state[:, 1 : 1 + model.nq] = model.qpos0
        state[:, 1 + self._plant.positions] = motion.position[starts]
        state[:, 1 + model.nq + self._plant.velocities] = motion.velocity[starts]
        with np.errstate(all="ignore"):
            simulated, _ = rollout(model, mujoco.MjData(model), state, torque, control_spec=_APPLIED)
            went = np.asarray(simulated)[:, substeps - 1 :: substeps, 1 + self._plant.positions]
            was = motion.position[rows + 1]
            left = np.sqrt(np.mean((went - was) ** 2, axis=1))
        moved = np.sqrt(np.mean((was - motion.position[starts][:, None]) ** 2, axis=1))
        return np.where(np.isfinite(left), left, np.inf) / np.where(moved > _STILL * motion.noise, moved, np.nan)

    def _model(self, step_s: float, losses: Losses) -> mujoco.MjModel:
        model = self._plant.forward_model()
        model.opt.timestep = step_s / np.ceil(step_s / _LONGEST_STEP_S)
        recorded = self._plant.velocities
        held = np.setdiff1d(np.arange(model.nv), recorded)
        model.dof_armature[held] = _HELD_KG_M2
        model.dof_frictionloss[recorded], model.dof_damping[recorded] = losses.coulomb_nm, losses.damping_nm_s_rad
        return model


def windows_of(motion: Motion, window_s: float, every_s: float, counts: np.ndarray) -> np.ndarray:
    """Starts of windows in which everything is known and every sample counts, ``every_s`` apart; ``counts`` of shape (s,)."""
    samples = round(window_s / motion.step_s)
    starts = np.arange(0, len(motion.position) - samples - 1, max(1, round(every_s / motion.step_s)))
    fine = motion.known & counts
    sums = np.concatenate([[0], np.cumsum(~fine)])
    return starts[sums[starts + samples + 1] - sums[starts] == 0]
