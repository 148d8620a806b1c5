"""What a trial begins with, whoever made it ready."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from api_schemas.robot import Lease
from robot_farm.alarm import Alarm
from robot_farm.faults import Change
from robot_farm.sight import Sight
from robot_farm.truth import TruthFile
from sim_backend.driver.driver import Start
from sim_backend.driver.tracker import Tracker
from sim_backend.effects.physics import Physics
from sim_backend.tasks.own import with_own
from sim_backend.tasks.task import Goal, Task, draw_trial
from sim_backend.trifinger.objects import CUBE, Shape, resting_height_m, shape_of

if TYPE_CHECKING:
    from sim_backend.vision.image_detector import ImageDetector


@dataclass(frozen=True)
class TrialPhysics:
    """What a robot is in one attempt at a trial.

    Physics (n = 1), the seed of its noise (a whole number below 2**53), and a generator for what the robot does by chance.
    """

    physics: Physics
    noise_seed: int
    rng: np.random.Generator


@dataclass(frozen=True)
class Prepared:
    """Start, goal and cameras of a trial; the task is None for an excitation, which has no goal either.

    The rest is for robots that are not ideal: ``changes`` are faults that come within the trial, ``events`` say what was
    done to get ready, ``truth`` is where the truth is written (None: into the log), ``alarm`` watches the robot, and ``close``
    ends the trial on the robot's side: it is told at which step and whether the robot failed, and says what is wrong with it.
    ``detector`` is what looks at images where the tracker has any.
    """

    start: Start
    goal: Goal
    tracker: Tracker
    task: Task | None
    physics: Physics = field(default_factory=Physics.nominal)
    changes: tuple[Change, ...] = ()
    events: tuple[str, ...] = ()
    truth: TruthFile | None = None
    alarm: Alarm | None = None
    detector: "ImageDetector | None" = None
    close: Callable[[int, bool], str | None] = lambda _step, _failed: None


def prepare_plainly(lease: Lease, tasks: dict[str, Task], sight: Sight | None = None) -> Prepared:
    """Everything from the lease alone, as robots that are all alike begin: the object is placed where the seed says.

    Args:
        lease: what is to be tried.
        tasks: by name.
        sight: what finds the object; the formula if None.
    """
    sight = Sight() if sight is None else sight
    shape = shape_of_lease(lease)
    start, goal = draw_start_and_goal(lease, tasks, shape)
    tracker = sight.tracker(shape=shape)
    return Prepared(start, goal, tracker, tasks.get(lease.task.value), detector=sight.detector)


def shape_of_lease(lease: Lease) -> Shape:
    """The object that the trial is to be tried with."""
    return shape_of(lease.object.value, lease.object_scale)


def draw_start_and_goal(lease: Lease, tasks: dict[str, Task], shape: Shape) -> tuple[Start, Goal]:
    """What the lease's seed stands for, or its user brought, with the object on the table.

    An excitation's goal is any task's and means nothing.
    """
    start, goal = draw_trial(tasks.get(lease.task.value) or next(iter(tasks.values())), lease.seed)
    start, goal = with_own(start, goal, lease.own_goal)
    if shape == CUBE:
        return start, goal
    position_m = start.cube_position_world_m.copy()
    position_m[:, 2] = resting_height_m(shape, start.cube_quat_wxyz)
    return replace(start, cube_position_world_m=position_m), goal
