"""Recordings read in some way: the torques that were given and needed then, and what they leave of each other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import COULOMB_FRICTION, VISCOUS_FRICTION
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations

FEWEST_ROWS = 100
"""Of which a joint's torques are judged."""
_BLURRED_RAD_S, _STRETCH_S = 0.02, 1.2


@dataclass(frozen=True)
class Reading:
    """How to read the data: factors of each joint's positions and torques, shapes (k,), and of clocks.

    Torques are dated ``late_s`` too late, and the told clock lets ``pace`` pass for each second. What ``zeros_rad`` says comes on
    top of positions, shape (k,), rad.
    """

    positions: np.ndarray
    torques: np.ndarray
    late_s: float = 0.0
    pace: float = 1.0
    zeros_rad: np.ndarray | float = 0.0


@dataclass(frozen=True)
class ToldEpisode:
    """One episode as it is told: torques given and needed, shapes (t, k), N m.

    What is needed has the friction that the model has: damping of its joints, and beside that ``coulomb_nm`` and
    ``damping_nm_s_rad``, shapes (k,), which take ``friction_nm`` of shape (t, k).
    """

    episode: EpisodeEquations
    given: np.ndarray
    needed: np.ndarray
    coulomb_nm: np.ndarray
    damping_nm_s_rad: np.ndarray
    friction_nm: np.ndarray


@dataclass(frozen=True)
class TorqueRows:
    """Of one joint, what counts of all episodes: torque given, torque needed, and what is set free, shapes (r,) and (r, 3).

    ``rotor`` is what each unit of rotor inertia that the model lacks would need, shape (r,).
    """

    given: np.ndarray
    needed: np.ndarray
    free: np.ndarray
    rotor: np.ndarray


def is_held_out(time_s: np.ndarray) -> np.ndarray:
    """Every other stretch of an episode."""
    return np.floor(time_s / _STRETCH_S).astype(int) % 2 == 1


def told_by(episode: EpisodeEquations, start: JointState) -> ToldEpisode:
    """An episode as it is told, by the nominal model."""
    given = episode.path.smoothed(episode.acting_nm).T
    error, own = episode.torque_error(start), episode.plant.own_values[VISCOUS_FRICTION]
    own_alone = {(COULOMB_FRICTION, j): 0.0 for j in range(len(own))} | {(VISCOUS_FRICTION, j): d for j, d in enumerate(own)}
    rubs = episode.torque_error(start.with_values(own_alone)) - error
    return ToldEpisode(episode, given, given - error, start.value(COULOMB_FRICTION), start.value(VISCOUS_FRICTION) - own, rubs)


def all_rows(
    data: Sequence[ToldEpisode],
    factor: np.ndarray | None = None,
    late_s: float = 0.0,
    pace: float = 1.0,
    zeros_rad: np.ndarray | float = 0.0,
    *,
    held_out: bool | None = None,
) -> list[TorqueRows]:
    """Rows of each joint; positions times ``factor`` of shape (k,), torques as they are dated ``late_s`` after the motion.

    ``pace`` is that of the clock, and ``zeros_rad`` is added to positions, shape (k,).

    ``held_out`` asks for one half of the stretches only.
    """
    parts = []
    for told in data:
        path, given, needed = told.episode.path, told.given, told.needed
        by = np.ones(path.position.shape[1]) if factor is None else factor
        velocity = path.velocity * by * pace
        if factor is not None or pace != 1.0 or np.any(zeros_rad):
            moved = (path.position * by + zeros_rad, velocity, path.acceleration * by * pace**2)
            needed = needed + told.episode.plant.torque_nm(*moved) - told.episode.dynamics.torque_nm
            needed = needed - (1.0 - np.sign(by)) * told.friction_nm  # what is turned rubs the other way
        if late_s:
            given = np.stack([np.interp(path.time_s + late_s, path.time_s, column) for column in given.T], axis=1)
        counts = told.episode.valid_mechanics
        if held_out is not None:
            counts = counts & (is_held_out(path.time_s - path.time_s[0]) == held_out)[:, None]
        parts.append((given, needed, velocity, path.acceleration * by * pace**2, counts))
    found = []
    for j in range(parts[0][0].shape[1]):
        given, needed, velocity, rotor = (np.concatenate([part[i][part[4][:, j], j] for part in parts]) for i in range(4))
        found.append(TorqueRows(given, needed, free_columns(velocity), rotor))
    return found


def free_columns(velocity: np.ndarray) -> np.ndarray:
    """What is set free beside any reading, for a motion of shape (r,): dry friction, damping and a constant; shape (r, 3)."""
    return np.stack([np.tanh(velocity / _BLURRED_RAD_S), velocity, np.ones_like(velocity)], axis=1)


def errors_of(rows: Sequence[TorqueRows]) -> np.ndarray:
    """What each joint leaves with its torques as they are, shape (k,), N m; NaN where too few rows count."""
    return np.array([left_with_factor(of_joint, 1.0) if len(of_joint.given) >= FEWEST_ROWS else np.nan for of_joint in rows])


def left_with_factor(rows: TorqueRows, factor: float) -> float:
    """What is left of a joint's torques times a factor, root mean square, N m."""
    return rms_left(factor * rows.given - rows.needed, rows.free)[0]


def left_with_any_factor(rows: TorqueRows) -> tuple[float, float, float]:
    """What is left with the best factor of the torques, that factor, and what is left without any torque."""
    left, coefficients = rms_left(rows.needed, np.column_stack([rows.given, rows.free]))
    return left, float(coefficients[0]), rms_left(rows.needed, rows.free)[0]


def left_with_rotor(rows: TorqueRows) -> tuple[float, float, float]:
    """What is left with the best rotor inertia beside the model's, that inertia, and what is left without any motion."""
    left, coefficients = rms_left(rows.given - rows.needed, np.column_stack([rows.rotor, rows.free]))
    return left, float(coefficients[0]), rms_left(rows.given, rows.free)[0]


def rms_left(values: np.ndarray, images: np.ndarray) -> tuple[float, np.ndarray]:
    """What is left of values with the best sum of images, root mean square and at least 1e-12, and its coefficients."""
    coefficients = np.linalg.lstsq(images, values, rcond=None)[0]
    return max(float(np.sqrt(np.mean((values - images @ coefficients) ** 2))), 1e-12), coefficients
