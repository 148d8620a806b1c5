"""What is practised and how, by names: a task, what is seen, what actions mean, what is rewarded, which robots there are."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from api_schemas.policy import PolicyManifest
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import Ranges, load_ranges
from sim_backend.environments.action_space import ActionMode, ActionSpace
from sim_backend.layouts import layout_of
from sim_backend.tasks import TASKS
from sim_backend.tasks.reward import Reward, RewardKind
from sim_backend.tasks.task import Task
from sim_backend.trifinger import constants as c

DrawPhysics = Callable[[np.random.Generator, np.ndarray], Physics]
"""Physics of the robots that begin a trial, from their indices (n,)."""


@dataclass(frozen=True)
class Practice:
    """What is practised and how.

    ``episode_s`` is the length of a trial (the task's own if None); ``physics_step_s`` the integration step. ``draw_physics``
    gives the effects of robots that begin a trial; nominal if None.
    """

    task: Task
    manifest: PolicyManifest
    action_space: ActionSpace = field(default_factory=ActionSpace)
    reward: Reward = field(default_factory=Reward)
    draw_physics: DrawPhysics | None = None
    episode_s: float | None = None
    physics_step_s: float = c.PHYSICS_STEP_S

    @property
    def periods(self) -> int:
        """Control periods of a trial."""
        return round((self.episode_s or self.task.duration_s) * self.manifest.rate_hz)


def practice_of(
    task: str,
    *,
    layout: str | PolicyManifest | None = None,
    action: str | ActionSpace = "torque",
    reward: str | Reward = "keypoint kernel",
    physics: str | DrawPhysics = "nominal",
    episode_s: float | None = None,
    physics_step_s: float = c.PHYSICS_STEP_S,
) -> Practice:
    """What is practised, by names; arguments as for ``TrifingerEnv``.

    Raises:
        ValueError: a name that does not exist; the message lists those that do.

    Example:
        >>> import trifarm
        >>> trifarm.practice_of("lift", physics="real").periods
        1500
    """
    if task not in TASKS:
        raise ValueError(f"unknown task {task!r}; choose from {', '.join(TASKS)}")
    chosen = layout or ("keypoints" if TASKS[task].moves_cube else "reach")
    seen = layout_of(chosen) if isinstance(chosen, str) else chosen
    acts = ActionSpace(ActionMode(action)) if isinstance(action, str) else action
    return Practice(
        TASKS[task],
        acts.manifest(seen),
        acts,
        Reward(RewardKind(reward)) if isinstance(reward, str) else reward,
        drawing_from(load_ranges(physics)) if isinstance(physics, str) else physics,
        episode_s,
        physics_step_s,
    )


def drawing_from(ranges: Ranges) -> DrawPhysics:
    """Draws robots from ranges."""
    return lambda rng, robots: ranges.draw_episode(rng, ranges.draw(rng, len(robots)))
