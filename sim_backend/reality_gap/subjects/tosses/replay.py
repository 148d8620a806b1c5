"""Replays of tosses through MuJoCo from their measured state, and the pose at which an object comes to rest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.rollout import rollout

from sim_backend.reality_gap.subjects.tosses.geometry import ObjectGeometry, gaps_m
from sim_backend.reality_gap.subjects.tosses.models import HEIGHT, SCALE, compiled, upward
from sim_backend.reality_gap.subjects.tosses.stretches import Toss

_STEP_S = 0.002  # of the integration at most; MuJoCo takes contacts no stiffer than two steps
_GROUP = 48  # tosses of similar length that are replayed in one call
_SETTLE_S = 0.3  # an object put down flat within a degree lies still after this time


@dataclass(frozen=True)
class Replayer:
    """What replays need: the nominal specification, the object, the step (s) and the number of threads."""

    spec: mujoco.MjSpec
    geometry: ObjectGeometry
    step_s: float
    threads: int = 1

    def model(self, values: Mapping[str, float]) -> mujoco.MjModel:
        """Compiled with other values."""
        return compiled(self.spec, self.geometry, values, self.step_s)


def replay_step_s(tosses: Sequence[Toss]) -> float:
    """A whole part of the median sampling step, at most 2 ms."""
    step_s = float(np.median(np.concatenate([np.diff(toss.time_s) for toss in tosses])))
    return step_s / np.ceil(step_s / _STEP_S - 1e-9)


def replayed(
    replayer: Replayer, tosses: Sequence[Toss], values: Mapping[str, float], rng: np.random.Generator | None = None
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses that the tracker would report of each toss, at the times of the measured ones.

    Args:
        replayer: what it needs.
        tosses: any number.
        values: of effects on the body and of the measurement, by catalogue key.
        rng: if given, the velocities at the start are drawn from within their uncertainty.

    Returns:
        For each toss positions (m, 3) and orientations (m, 4).
    """
    model, up = replayer.model(values), upward(replayer.geometry.model)
    scale, offset = 1.0 + values.get(SCALE, 0.0), values.get(HEIGHT, 0.0) * up
    data = mujoco.MjData(model)
    states = np.array([_state(model, data, replayer.geometry, toss, scale, offset, rng) for toss in tosses])
    steps = np.array([int(np.ceil(toss.time_s[-1] / replayer.step_s)) + 1 for toss in tosses])
    out: list = [None] * len(tosses)
    order = np.argsort(steps)
    for rows in (order[i : i + _GROUP] for i in range(0, len(order), _GROUP)):
        paths = _rollout(model, states[rows], int(steps[rows].max()), replayer.threads)
        for row, path in zip(rows, paths, strict=True):
            position, quat = _at(path[:, _columns(replayer.geometry)], tosses[row].time_s / replayer.step_s)
            out[row] = scale * position + offset, quat
    return out


def settled(
    replayer: Replayer, poses: tuple[np.ndarray, np.ndarray], values: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Where the object lies after it was put down in each pose; a small error of the orientation settles.

    Args:
        replayer: what it needs.
        poses: positions (n, 3) and orientations (n, 4) as seen at rest.
        values: of effects on the body.

    Returns:
        Positions (n, 3) and orientations (n, 4).
    """
    model, geometry = replayer.model(values), replayer.geometry
    position = poses[0] - gaps_m(model, geometry, *poses)[:, None] * upward(geometry.model)
    data, still = mujoco.MjData(model), np.zeros(6)
    states = np.array([_packed(model, data, geometry, p, q, still) for p, q in zip(position, poses[1], strict=True)])
    path = _rollout(model, states, int(_SETTLE_S / replayer.step_s), replayer.threads)[:, -1, _columns(geometry)]
    return path[:, :3], path[:, 3:]


def _columns(geometry: ObjectGeometry) -> slice:
    return slice(1 + geometry.qpos, 1 + geometry.qpos + 7)  # the state begins with the time


def _state(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    geometry: ObjectGeometry,
    toss: Toss,
    scale: float,
    offset: np.ndarray,
    rng: np.random.Generator | None,
) -> np.ndarray:
    velocity = np.concatenate([toss.velocity_m_s, toss.angular_velocity_rad_s])
    if rng is not None:
        velocity += rng.standard_normal(6) * np.repeat([toss.velocity_std_m_s, toss.angular_velocity_std_rad_s], 3)
    velocity[:3] /= scale
    return _packed(model, data, geometry, (toss.position_m[0] - offset) / scale, toss.quat_wxyz[0], velocity)


def _packed(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    geometry: ObjectGeometry,
    position_m: np.ndarray,
    quat_wxyz: np.ndarray,
    velocity: np.ndarray,
) -> np.ndarray:
    data.qpos[geometry.qpos : geometry.qpos + 3] = position_m
    data.qpos[geometry.qpos + 3 : geometry.qpos + 7] = quat_wxyz
    data.qvel[geometry.dof : geometry.dof + 6] = velocity
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


def _rollout(model: mujoco.MjModel, states: np.ndarray, steps: int, threads: int) -> np.ndarray:
    """States from the first on, shape (n, steps + 1, size)."""
    data = [mujoco.MjData(model) for _ in range(threads)]
    path, _ = rollout(model, data, states, nstep=steps)
    return np.concatenate([states[:, None], np.asarray(path)], axis=1)


def _at(path: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses (m, 7) between steps, at ``place`` in steps."""
    low = np.minimum(place.astype(int), len(path) - 2)
    share = (place - low)[:, None]
    pose = (1.0 - share) * path[low] + share * path[low + 1]
    return pose[:, :3], pose[:, 3:] / np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
