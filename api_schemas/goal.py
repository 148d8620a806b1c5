"""Goals that users bring, and goals as the API shows them."""

import math
from typing import Annotated

from pydantic import AfterValidator, Field

from api_schemas.schema import Schema

ARENA_RADIUS_M = 0.195
"""Of the arena's floor; compared with the robot's constants in a test."""
MAX_DISTANCE_M = ARENA_RADIUS_M - 0.065 * math.sqrt(3) / 2
"""Of the object's middle from that of the arena, as far as drawn goals lie; compared with the robot's constants in a test."""
REST_HEIGHT_M = 0.0325
MAX_HEIGHT_M = 0.1
UNIT_WITHIN = 1e-3
ON_THE_FLOOR = frozenset({"push", "floor_pose", "move_cube_1"})
IN_THE_AIR = frozenset({"lift", "move_cube_2", "move_cube_3", "move_cube_4"})
"""Tasks whose goals a user may bring; those of reach are fingertips, which not every pose of the fingers brings there."""


def _unit(quat: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    length = math.hypot(*quat)
    if abs(length - 1) > UNIT_WITHIN:
        raise ValueError(f"a quaternion (w, x, y, z) has length 1, this one {length:.3g}")
    w, x, y, z = (each / length for each in quat)
    return (w, x, y, z)


def _in_arena(position: tuple[float, ...]) -> tuple[float, ...]:
    distance_m = math.hypot(*position[:2])
    if distance_m > MAX_DISTANCE_M + 1e-9:
        raise ValueError(f"it lies {distance_m:.3f} m from the middle of the arena, and may at most {MAX_DISTANCE_M:.4f} m")
    return position


Quat = Annotated[tuple[float, float, float, float], AfterValidator(_unit)]
OnTable = Annotated[tuple[float, float], AfterValidator(_in_arena)]
InArena = Annotated[tuple[float, float, float], AfterValidator(_in_arena)]


class OwnStart(Schema):
    """Where the object begins: on the table, the right way up."""

    position_m: OnTable = Field(description="x and y of its middle")
    yaw_rad: float = Field(default=0.0, ge=-2 * math.pi, le=2 * math.pi)


class OwnGoal(Schema):
    """A goal that a user brings, and perhaps the start; without one, the trial's seed draws it."""

    position_m: InArena = Field(description="x, y and z of the object's middle in the world")
    quat_wxyz: Quat = (1.0, 0.0, 0.0, 0.0)
    start: OwnStart | None = None


def why_unfit(goal: OwnGoal, task: str) -> str | None:
    """Why the task cannot have this goal; None if it can."""
    if task not in ON_THE_FLOOR | IN_THE_AIR:
        return f"{task} takes no goals of one's own; choose from {', '.join(sorted(ON_THE_FLOOR | IN_THE_AIR))}"
    z = goal.position_m[2]
    if task in ON_THE_FLOOR and abs(z - REST_HEIGHT_M) > UNIT_WITHIN:
        return f"goals of {task} lie on the floor, with z {REST_HEIGHT_M} m, not {z:g} m"
    if not REST_HEIGHT_M - UNIT_WITHIN <= z <= MAX_HEIGHT_M:
        return f"the goal's z is {z:g} m, and may be {REST_HEIGHT_M} to {MAX_HEIGHT_M} m"
    _, x, y, _ = goal.quat_wxyz
    if task == "floor_pose" and math.hypot(x, y) > UNIT_WITHIN:
        return "goals of floor_pose are turned about the vertical alone: x and y of their quaternion are 0"
    return None


class TrialGoal(Schema):
    """The goal of one trial and where its object begins; fingertips instead of a pose for ``reach``.

    Robots that sweep their arena leave the object where it comes to lie, unless the start is one's own.
    """

    trial: int
    seed: int
    is_own: bool
    position_m: tuple[float, float, float] | None
    quat_wxyz: tuple[float, float, float, float] | None
    fingertip_position_m: tuple[float, ...] | None = None
    start_position_m: tuple[float, float, float]
    start_quat_wxyz: tuple[float, float, float, float]


class JobGoals(Schema):
    """Answer of GET /v1/jobs/{job}/goals: all or one page of a job's goals, in the order of its trials."""

    job_id: str
    task: str
    goals: tuple[TrialGoal, ...]
    next_cursor: str | None = None
