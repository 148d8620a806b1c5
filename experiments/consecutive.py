"""Goal after goal in one trial, many trials at once in simulation: how many are reached in a row, and what ended it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from api_schemas.policy import PolicyManifest
from experiments.design import ManyGoals
from sim_backend.effects.physics import Physics
from sim_backend.evaluation import Act, Remembering, begin_trials
from sim_backend.tasks import TASKS
from sim_backend.tasks.scoring import score
from sim_backend.tasks.task import Task, stack_goals
from sim_backend.trifinger.objects import CUBE, resting_height_m

LIFTED_M, RESTING_M = 0.02, 0.003
"""An object has been lifted when its centre was so much above where it rests, and lies when it is no more than that above."""
FALLING_M_S = 0.3
"""An object that comes down faster was dropped, a slower one was set down; 2 cm of free fall end with twice as much."""
IN_THE_AIR = ("lift", "move_cube_2", "move_cube_3", "move_cube_4")
"""Tasks whose goals are in the air, where an object can be dropped."""


class End(StrEnum):
    """What ended a trial."""

    ALL_REACHED = "all reached"
    DROP = "drop"
    TIME = "time"


@dataclass
class Judge:
    """Keeps count of n trials. Owner of who has ended and why.

    Args:
        trials: n.
        goals: after so many a trial ends.
        limit_s: for a goal.
        can_drop: whether an object that falls on the table after it was lifted ends a trial.
    """

    trials: int
    goals: int
    limit_s: float
    can_drop: bool

    def __post_init__(self) -> None:
        self.reached = np.zeros(self.trials, dtype=int)
        self.ended: list[End | None] = [None] * self.trials
        self._since_s = np.zeros(self.trials)
        self._lifted = np.zeros(self.trials, dtype=bool)
        self._above_rest_m = np.zeros((3, self.trials))  # in the last control periods, the newest last
        self._seen_s = 0.0

    @property
    def over(self) -> bool:
        """Whether all have ended."""
        return all(end is not None for end in self.ended)

    def see(self, success: np.ndarray, above_rest_m: np.ndarray, now_s: float) -> np.ndarray:
        """Take one control period of all trials; returns the rows that need another goal now.

        Args:
            success: whether the goal is reached, shape (n,).
            above_rest_m: height of the object's centre above where it rests in its orientation, m, shape (n,).
            now_s: since the start of all.
        """
        going = np.array([end is None for end in self.ended])
        dropped = self._dropped(above_rest_m, now_s)
        arrived = going & success
        self.reached[arrived] += 1
        self._since_s[arrived] = now_s
        for row in np.flatnonzero(going):
            if self.reached[row] >= self.goals:
                self.ended[row] = End.ALL_REACHED
            elif dropped[row]:
                self.ended[row] = End.DROP
            elif now_s - self._since_s[row] >= self.limit_s - 1e-9:
                self.ended[row] = End.TIME
        return np.array([row for row in np.flatnonzero(arrived) if self.ended[row] is None], dtype=int)

    def _dropped(self, above_rest_m: np.ndarray, now_s: float) -> np.ndarray:
        """Which objects lie on the table again after they fell, shape (n,); a fall may end early in its last control period."""
        period_s, self._seen_s = now_s - self._seen_s, now_s
        self._above_rest_m = np.vstack([self._above_rest_m[1:], above_rest_m])
        fell = (-np.diff(self._above_rest_m, axis=0) > FALLING_M_S * period_s).any(axis=0)
        lies = above_rest_m < RESTING_M
        dropped = self._lifted & lies & fell & self.can_drop
        self._lifted = (self._lifted & ~lies) | (above_rest_m > LIFTED_M)
        return dropped


def try_many_goals(
    act: Act,
    manifest: PolicyManifest,
    task: Task,
    design: ManyGoals,
    physics: Physics | None,
    *,
    threads: int = 1,
    tell: Callable[[str], None] = lambda _: None,
) -> dict:
    """Let a policy try goal after goal; as JSON has it: reached goals and end of each trial, in the order of their seeds."""
    seeds = range(design.first_seed, design.first_seed + design.trials)
    episode, goal = begin_trials(manifest, task, seeds, physics=physics, threads=threads, physics_step_s=design.physics_step_s)
    rngs = [np.random.default_rng((seed, 1)) for seed in seeds]
    if isinstance(act, Remembering):
        act.begin(len(seeds))
    judge = Judge(design.trials, design.goals, design.limit_s, task.name in IN_THE_AIR)
    periods, now_s = 0, 0.0
    while not judge.over:
        episode.advance(np.asarray(act(episode.observe().astype(np.float32)), dtype=float))
        periods += 1
        now_s, state = periods / manifest.rate_hz, episode.measurement
        place, turned = state.cube_position_world_m, state.cube_quat_wxyz
        scores = score(task, goal, place, turned, state.true_joint_position_rad)
        rows = judge.see(scores.success, place[:, 2] - resting_height_m(CUBE, turned), now_s)
        if len(rows):
            fresh = stack_goals([task.draw_goal(rngs[row]) for row in rows])
            goal = goal.with_rows(rows, fresh)
            episode.change_goals(rows, fresh)
        if periods % (60 * manifest.rate_hz) == 0:
            left = sum(end is None for end in judge.ended)
            tell(f"{now_s:.0f} s: {left} of {design.trials} trials go on, {judge.reached.mean():.1f} goals in the mean")
    return {
        "trials": design.trials,
        "reached": judge.reached.tolist(),
        "ended": [str(end) for end in judge.ended],
        "simulated_s": round(now_s, 2),
    }


def summary(reached: Sequence[int]) -> dict:
    """Mean, median and sorted trials, as the paper has them."""
    ordered = sorted(reached, reverse=True)
    deviation = float(np.std(ordered, ddof=1)) if len(ordered) > 1 else 0.0
    return {"mean": float(np.mean(ordered)), "deviation": deviation, "median": float(np.median(ordered)), "sorted": ordered}


def task_of(name: str) -> Task:
    """A task by its name."""
    return TASKS[name]
