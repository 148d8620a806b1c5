"""A task: how long it lasts, how starts and goals are drawn, and which errors count."""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from sim_backend.driver.driver import Start
from sim_backend.trifinger import constants as c


@dataclass(frozen=True)
class Goal:
    """The wanted pose for n trials: cube (n, 3) in m and (n, 4) wxyz, and fingertips (n, 9) in m (for ``reach``)."""

    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray
    fingertip_position_world_m: np.ndarray

    def rows(self, index: np.ndarray) -> "Goal":
        """The goals of some of the trials, in this order."""
        return Goal(**{field.name: getattr(self, field.name)[index] for field in fields(Goal)})

    def with_rows(self, index: np.ndarray, goals: "Goal") -> "Goal":
        """The same trials, but those of ``index`` with other goals."""
        merged = {field.name: getattr(self, field.name).copy() for field in fields(Goal)}
        for name, values in merged.items():
            values[index] = getattr(goals, name)
        return Goal(**merged)


@dataclass(frozen=True)
class Task:
    """What is asked. ``draw_goal`` takes a generator and gives the goal of one trial (n = 1)."""

    name: str
    duration_s: float
    draw_goal: Callable[[np.random.Generator], Goal]
    about: str
    moves_cube: bool = True
    orientation_counts: bool = False
    challenge_cost: bool = False  # the 2020 challenge's cost as return, instead of the keypoint kernel
    starts_upright: bool = False  # where the object is placed; a swept arena leaves any face up

    @property
    def steps(self) -> int:
        """Duration in physics steps of 1 ms."""
        return round(self.duration_s / c.PHYSICS_STEP_S)


def draw_trial(task: Task, seed: int) -> tuple[Start, Goal]:
    """Start and goal of one trial (n = 1), from nothing but the trial's seed."""
    rng = np.random.default_rng(seed)
    return draw_start(rng, upright=task.starts_upright), task.draw_goal(rng)


def draw_start(rng: np.random.Generator, *, upright: bool = False) -> Start:
    """Fingers in their start pose; the cube anywhere on the floor, any face up, any yaw (move_cube, initial pose).

    ``upright`` leaves only the yaw to chance.
    """
    position = np.array([*draw_in_disc(rng, c.MAX_CUBE_CENTRE_DISTANCE_M), c.CUBE_REST_HEIGHT_M])
    quat = draw_yaw_quat_wxyz(rng) if upright else draw_face_up_quat_wxyz(rng)
    return Start(c.START_JOINT_POSITION_RAD[None].copy(), position[None], quat[None])


def draw_in_disc(rng: np.random.Generator, radius_m: float) -> np.ndarray:
    """A point uniform in a disc around the origin, shape (2,), m."""
    angle, radius = rng.uniform(0, 2 * np.pi), radius_m * np.sqrt(rng.uniform())
    return np.array([radius * np.cos(angle), radius * np.sin(angle)])


_QUARTER = np.sqrt(0.5)
_FACE_UP_QUATS = np.array(
    [
        [1.0, 0.0, 0.0, 0.0],
        [_QUARTER, _QUARTER, 0.0, 0.0],
        [_QUARTER, -_QUARTER, 0.0, 0.0],
        [_QUARTER, 0.0, _QUARTER, 0.0],
        [_QUARTER, 0.0, -_QUARTER, 0.0],
        [0.0, 1.0, 0.0, 0.0],
    ]
)


def draw_face_up_quat_wxyz(rng: np.random.Generator) -> np.ndarray:
    """A random face up, then a random yaw; shape (4,)."""
    tilt = _FACE_UP_QUATS[rng.integers(6)]
    half_yaw = rng.uniform(0, 2 * np.pi) / 2
    cos, sin = np.cos(half_yaw), np.sin(half_yaw)
    w, x, y, z = tilt
    return np.array([cos * w - sin * z, cos * x - sin * y, cos * y + sin * x, cos * z + sin * w])


def draw_yaw_quat_wxyz(rng: np.random.Generator) -> np.ndarray:
    """The +z face up, then a random yaw; shape (4,)."""
    half_yaw = rng.uniform(0, 2 * np.pi) / 2
    return np.array([np.cos(half_yaw), 0.0, 0.0, np.sin(half_yaw)])


def draw_quat_wxyz(rng: np.random.Generator) -> np.ndarray:
    """An orientation uniform in SO(3), shape (4,)."""
    quat = rng.standard_normal(4)
    return quat / np.linalg.norm(quat)


def stack_starts(starts: list[Start]) -> Start:
    """Starts of several trials as one with a longer leading axis."""
    return Start(
        np.concatenate([start.joint_position_rad for start in starts]),
        np.concatenate([start.cube_position_world_m for start in starts]),
        np.concatenate([start.cube_quat_wxyz for start in starts]),
    )


def stack_goals(goals: list[Goal]) -> Goal:
    """Goals of several trials as one with a longer leading axis."""
    return Goal(
        np.concatenate([goal.cube_position_world_m for goal in goals]),
        np.concatenate([goal.cube_quat_wxyz for goal in goals]),
        np.concatenate([goal.fingertip_position_world_m for goal in goals]),
    )
