"""Many trials at once on simulated robots, without farm and logs: what training and studies measure success with.

The same control period, effects and scores as in a trial on the farm; one simulation for each trial.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from api_schemas.policy import PolicyManifest
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import Tracker
from sim_backend.effects.physics import Physics
from sim_backend.episode import Episode
from sim_backend.tasks.scoring import score
from sim_backend.tasks.task import Goal, Task, draw_trial, stack_goals, stack_starts
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE, Shape

Act = Callable[[np.ndarray], np.ndarray]
"""A policy: observations (n, size) as float32 to actions (n, 9)."""


@runtime_checkable
class Remembering(Protocol):
    """A policy that keeps something of each trial, such as the states of an LSTM."""

    def begin(self, trials: int) -> None:
        """Forget all that was, and begin that many trials; row i of the observations is from now on trial i."""
        ...

    def __call__(self, observation: np.ndarray, /) -> np.ndarray:
        """Actions (n, 9) of the next observation (n, size) of each trial."""
        ...


@dataclass(frozen=True)
class Evaluation:
    """What n trials achieved: success at the end (n,), and the errors there in m and rad, (n,)."""

    success: np.ndarray
    position_error_m: np.ndarray
    angle_error_rad: np.ndarray


def evaluate(
    act: Act,
    manifest: PolicyManifest,
    task: Task,
    seeds: Sequence[int],
    *,
    physics: Physics | None = None,
    noise_seeds: np.ndarray | None = None,
    shape: Shape = CUBE,
    threads: int = 2,
    physics_step_s: float = c.PHYSICS_STEP_S,
    tracker: Tracker | None = None,
) -> Evaluation:
    """Try the goals of the seeds with a policy, all at once; everything else as for :func:`begin_trials`.

    A policy that remembers (:class:`Remembering`) begins anew.
    """
    episode, goal = begin_trials(
        manifest,
        task,
        seeds,
        physics=physics,
        noise_seeds=noise_seeds,
        shape=shape,
        threads=threads,
        physics_step_s=physics_step_s,
        tracker=tracker,
    )
    if isinstance(act, Remembering):
        act.begin(len(seeds))
    for _ in range(task.steps // manifest.period_steps):
        episode.advance(np.asarray(act(episode.observe().astype(np.float32)), dtype=float))
    state = episode.measurement
    scores = score(task, goal, state.cube_position_world_m, state.cube_quat_wxyz, state.true_joint_position_rad)
    return Evaluation(scores.success, scores.position_error_m, scores.angle_error_rad)


def begin_trials(
    manifest: PolicyManifest,
    task: Task,
    seeds: Sequence[int],
    *,
    physics: Physics | None = None,
    noise_seeds: np.ndarray | None = None,
    shape: Shape = CUBE,
    threads: int = 2,
    physics_step_s: float = c.PHYSICS_STEP_S,
    tracker: Tracker | None = None,
) -> tuple[Episode, Goal]:
    """An episode of n trials that has begun, each with its object at rest on the table, and their goals.

    Args:
        manifest: what the policy expects.
        task: what is asked.
        seeds: one for each trial; draws start and goal as on the farm.
        physics: effects of each trial's robot, n rows; nominal if None.
        noise_seeds: shape (n,), seeds of noise; from the trials' seeds if None.
        shape: the object.
        threads: of the physics.
        physics_step_s: integration step, s.
        tracker: what finds the objects; the formula if None.
    """
    driver = SimulatedDriver(robots=len(seeds), threads=threads, physics_step_s=physics_step_s, physics=physics, shape=shape)
    tracker = tracker or Tracker(physics_step_s=physics_step_s, physics=driver.physics, shape=shape)
    episode = Episode(driver, tracker, manifest, physics_step_s=physics_step_s)
    drawn = [draw_trial(task, seed) for seed in seeds]
    start, goal = stack_starts([start for start, _ in drawn]), stack_goals([goal for _, goal in drawn])
    position = start.cube_position_world_m.copy()
    position[:, 2] = driver.rest_height_m(start.cube_quat_wxyz)
    noise = np.asarray(seeds, dtype=float) if noise_seeds is None else noise_seeds
    episode.begin(replace(start, cube_position_world_m=position, noise_seed=noise), goal)
    return episode, goal
