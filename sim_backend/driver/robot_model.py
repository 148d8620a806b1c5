"""The compiled model of one robot: the nominal scene, changed by the effects that MuJoCo has."""

import functools
from collections.abc import Callable

import mujoco
import numba
import numpy as np
from numba import types

from sim_backend.driver.compilation import compiled_once
from sim_backend.effects import friction, noise, record, sensing
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Acts
from sim_backend.effects.physics import Physics
from sim_backend.trifinger.objects import CUBE, Shape
from sim_backend.trifinger.scene import build_scene, discard_what_shows


def robot_spec(physics: Physics, *, shape: Shape = CUBE, physics_step_s: float) -> mujoco.MjSpec:
    """Specification of one robot with those of its effects that MuJoCo has (``Acts.MODEL``); others do not show in it.

    Args:
        physics: effects of one robot (n = 1).
        shape: the object in the arena.
        physics_step_s: integration step, s.
    """
    spec = _nominal_spec(physics_step_s, shape).copy()
    for effect in CATALOGUE.values():
        if effect.acts is Acts.MODEL and physics.has(effect.name):
            effect.apply(spec, {p.name: physics.value(effect.key(p))[0] for p in effect.all_parameters})
    return spec


@functools.lru_cache(maxsize=8)
def _nominal_spec(physics_step_s: float, shape: Shape) -> mujoco.MjSpec:
    """The nominal scene, not to be changed: a copy of it takes a twentieth of the time that building it anew does."""
    return build_scene(physics_step_s=physics_step_s, shape=shape)


def compile_robot(physics: Physics, *, shape: Shape = CUBE, physics_step_s: float) -> mujoco.MjModel:
    """The model that the driver runs: with a record for the control callback and a sensor for what it reports.

    It has nothing that only shows, so that no step is spent on it.
    """
    spec = discard_what_shows(robot_spec(physics, shape=shape, physics_step_s=physics_step_s))
    spec.nuserdata = record.record_size(physics_step_s)
    spec.add_sensor(
        name="report",
        type=mujoco.mjtSensor.mjSENS_USER,
        dim=record.REPORT_SIZE,
        needstage=mujoco.mjtStage.mjSTAGE_POS,  # cleared before the control callback writes it; a later stage sums up subtrees
    )
    if moves_bounds(physics):
        friction.reserve_bounds(spec)
    return spec.compile()


def needs_model(physics: Physics) -> bool:
    """Whether the robots' models differ from the nominal one."""
    return moves_bounds(physics) or any(e.acts is Acts.MODEL and physics.has(e.name) for e in CATALOGUE.values())


def moves_bounds(physics: Physics) -> bool:
    """Whether the control callback sets the bounds of joint friction."""
    return bool(moving_bounds(physics).any())


def moving_bounds(physics: Physics) -> np.ndarray:
    """For which robots the control callback sets the bounds of joint friction, shape (n,)."""
    return np.any([physics.having(name) for name in friction.MOVING_BOUNDS], axis=0)


def parameter_slots(physics: Physics, noise_seed: np.ndarray) -> np.ndarray:
    """What the effects fill in each robot's record, from ``CONTROL_SLOTS`` to the first state that changes.

    Args:
        physics: effects of n robots.
        noise_seed: seeds of their noise, shape (n,).

    Returns:
        Shape (n, slots): the parameters, then the errors that stay the same within a trial.
    """
    slots = np.zeros((physics.n, record.FILTERED_VELOCITY))
    for key, first in record.SLOTS.items():
        values = physics.value(key).reshape(physics.n, -1)
        slots[:, first : first + values.shape[1]] = values
    steps, joints = np.zeros(physics.n), np.arange(9)
    for key, first, channel in (
        ("joint_episode_noise.position_rad", record.POSITION_EPISODE, record.CHANNEL_POSITION_EPISODE),
        ("joint_episode_noise.velocity_rad_s", record.VELOCITY_EPISODE, record.CHANNEL_VELOCITY_EPISODE),
    ):
        if (physics.value(key) != 0.0).any():
            normal = _gaussians()(noise_seed.astype(float), steps, joints + channel)
            slots[:, first : first + 9] = sensing.noisy.py_func(0.0, physics.value(key), normal)  # pyrefly: ignore[missing-attribute] - once; not worth compiling
    return slots[:, record.CONTROL_SLOTS :]


@functools.cache
def _gaussians() -> Callable[..., np.ndarray]:
    """``noise.gaussians``, compiled once a machine."""
    seeds, channels = types.float64[:], types.int64[:]
    return compiled_once(lambda cache: numba.njit([(seeds, seeds, channels)], cache=cache)(noise.gaussians.py_func))
