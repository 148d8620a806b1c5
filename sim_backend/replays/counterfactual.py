"""Why a trial failed, by simulating it again without some of its robot's effects: policy in the loop, every noise the same.

Each number by chance is a function of noise seed, step and channel (``effects/noise.py``), and each effect draws from channels of
its own, so that taking one away leaves all others' noise as it was. A single replay that succeeds says little where a policy is
chaotic. What turned the trial is therefore tried again under other seeds of the noise, beside the unchanged robot under the same
seeds: the control.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Protocol

import numpy as np
from scipy.stats import beta

from api_schemas.policy import PolicyManifest
from sim_backend.driver.driver import Start
from sim_backend.driver.simulated import PhysicsDivergedError, SimulatedDriver
from sim_backend.driver.tracker import Tracker
from sim_backend.effects.causes import Cause, present
from sim_backend.effects.physics import Physics
from sim_backend.episode import Episode
from sim_backend.replays.comparison import shape_of_log
from sim_backend.replays.with_truth import change_physics, changes_of, goal_of, start_of
from sim_backend.tasks import TASKS
from sim_backend.tasks.scoring import score
from sim_backend.tasks.task import Goal, Task
from sim_backend.trifinger.objects import Shape
from trial_logs.reader import TrialLog, TruthLog

ROUND = 4
"""Replays with other noise at a time; a second round follows where the first leaves it open."""
ROUNDS = 2
SURE = 0.95
"""So likely must it be that the trial succeeds more often without the effect than with it."""
OPEN = 0.6
OFTEN = 0.5
"""A cause makes the trial succeed at least so often; a trial whose control succeeds so often failed by chance."""
CHANCES = np.linspace(0.0005, 0.9995, 1000)


class InLoop(Protocol):
    """A policy that is asked again."""

    def begin(self) -> None:
        """Forget the trial before."""
        ...

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The action (9,) of an observation (size,), float32."""
        ...


class Verdict(StrEnum):
    """What was found of a failed trial."""

    CAUSE = "cause"  # without one group, or several by themselves, it succeeds
    CHANCE = "chance"  # it often succeeds when only the noise is another
    TOGETHER = "together"  # only without several groups at once
    POLICY = "policy"  # it fails on the ideal robot, too


@dataclass(frozen=True)
class Again:
    """All that a trial begins with (n = 1); ``changes`` are faults that came within it, and before which step."""

    task: Task
    goal: Goal
    manifest: PolicyManifest
    shape: Shape
    start: Start
    physics: Physics
    changes: tuple[tuple[int, Physics], ...]

    @classmethod
    def of(cls, log: TrialLog, truth: TruthLog) -> "Again":
        """From a trial's log and truth."""
        assert log.manifest is not None, "a trial of a policy has a manifest"
        physics = Physics.from_document(truth.physics["effects"])
        manifest, task = PolicyManifest.model_validate_json(log.manifest), TASKS[log.metadata["task"]]
        return cls(task, goal_of(log), manifest, shape_of_log(log), start_of(truth), physics, tuple(changes_of(truth)))

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The groups that its robot has."""
        return present([self.physics, *(physics for _, physics in self.changes)])


@dataclass(frozen=True)
class End:
    """How a replay ended: whether at the goal, and how far from it, m (infinite where the physics became unstable)."""

    success: bool
    error_m: float


def replayed(trial: Again, policy: InLoop, away: Sequence[str] = (), noise_seed: int | None = None) -> End:
    """The trial without some effects, under its own noise or that of another seed."""
    physics = trial.physics.without(away)
    driver, tracker = SimulatedDriver(physics=physics, shape=trial.shape), Tracker(physics=physics, shape=trial.shape)
    episode = Episode(driver, tracker, trial.manifest)
    policy.begin()
    episode.begin(_start(trial, driver, noise_seed), trial.goal)
    changes = [(step, physics.without(away)) for step, physics in trial.changes]
    try:
        for _ in range(trial.task.steps // trial.manifest.period_steps):
            change_physics(changes, episode.step, driver, tracker)
            episode.advance(policy.act(episode.observe()[0].astype(np.float32))[None])
    except PhysicsDivergedError:
        return End(False, math.inf)
    state = episode.measurement
    ended = (state.cube_position_world_m, state.cube_quat_wxyz, state.true_joint_position_rad)
    scores = score(trial.task, trial.goal, *ended)
    return End(bool(scores.success[0]), float(scores.position_error_m[0]))


def _start(trial: Again, driver: SimulatedDriver, noise_seed: int | None) -> Start:
    """The start, with an object of another size still on the table."""
    start, factor = trial.start, trial.physics.value("cube_size.factor")
    position_m, height_m = start.cube_position_world_m.copy(), driver.rest_height_m(start.cube_quat_wxyz)
    if driver.physics.value("cube_size.factor") != factor:
        position_m[:, 2] += height_m * (1.0 - factor / driver.physics.value("cube_size.factor"))
    seed = start.noise_seed if noise_seed is None else np.array([noise_seed])
    return replace(start, cube_position_world_m=position_m, noise_seed=seed)


@dataclass(frozen=True)
class Tried:
    """What came of replays without ``away``: ``turned`` under the trial's own noise, then so many of so many successes.

    ``error_m`` is the mean distance from the goal at the end, ``sure`` the probability that it succeeds more often than the
    control.
    """

    name: str
    away: tuple[str, ...]
    turned: bool
    successes: int
    replays: int
    error_m: float
    sure: float

    @property
    def chance(self) -> float:
        """The share of successes under other noise; of the one replay where there were no others."""
        return self.successes / self.replays if self.replays else float(self.turned)

    @property
    def explains(self) -> bool:
        """Whether it is blamed."""
        return self.turned and self.replays > 0 and self.sure >= SURE and self.chance >= OFTEN


@dataclass(frozen=True)
class Explanation:
    """Groups and single effects, the likeliest cause first; ``ideal`` is the end on a robot without any effect."""

    verdict: Verdict
    control_successes: int
    control_replays: int
    ideal: End
    groups: tuple[Tried, ...]
    effects: tuple[Tried, ...]
    replays: int

    @property
    def blamed(self) -> tuple[Tried, ...]:
        """The groups that explain the failure."""
        return tuple(each for each in self.groups if each.explains)


def explain(
    trial: Again, policy: InLoop, *, effects: bool = True, told: Callable[[str, int], None] = lambda _what, _n: None
) -> Explanation:
    """Find what turns a failed trial into a success.

    Args:
        trial: which failed, as a first replay has shown.
        policy: the one that tried it.
        effects: also look for single effects within the groups that explain it.
        told: of progress: what is tried, and how many replays are done.
    """
    search = _Search(trial, policy, told)
    ideal = search.once("no effect at all", tuple(name for cause in trial.causes for name in cause.effects))
    groups = search.ranked([(cause.name, cause.effects) for cause in trial.causes])
    blamed = [name for each in groups if each.explains for name in each.away]
    singles: tuple[Tried, ...] = ()
    if effects and blamed:
        alone = {each.away[0]: replace(each, name=each.away[0]) for each in groups if each.explains and len(each.away) == 1}
        several = search.ranked([(name, (name,)) for name in blamed if name not in alone])
        singles = tuple(sorted((*several, *alone.values()), key=_order))
    successes, replays = search.control
    verdict = _verdict(any(each.explains for each in groups), successes, replays, ideal)
    return Explanation(verdict, successes, replays, ideal, groups, singles, search.done)


def _verdict(is_explained: bool, successes: int, replays: int, ideal: End) -> Verdict:
    if is_explained:
        return Verdict.CAUSE
    if replays and successes / replays >= OFTEN:
        return Verdict.CHANCE
    return Verdict.TOGETHER if ideal.success else Verdict.POLICY


class _Search:
    """Owner of what was replayed of one trial: the control's ends, and how many replays there were."""

    def __init__(self, trial: Again, policy: InLoop, told: Callable[[str, int], None]) -> None:
        self._trial, self._policy, self._told = trial, policy, told
        own = 0 if trial.start.noise_seed is None else int(trial.start.noise_seed[0])
        rng = np.random.default_rng([own, 2**53])
        self._seeds = rng.integers(0, 2**53, ROUND * ROUNDS).tolist()
        self._control: list[bool] = []
        self.done = 0

    @property
    def control(self) -> tuple[int, int]:
        """Successes and replays of the unchanged robot under other noise."""
        return sum(self._control), len(self._control)

    def once(self, what: str, away: tuple[str, ...], noise_seed: int | None = None) -> End:
        """One replay."""
        self._told(what, self.done)
        end = replayed(self._trial, self._policy, away, noise_seed)
        self.done += 1
        return end

    def ranked(self, choices: Sequence[tuple[str, tuple[str, ...]]]) -> tuple[Tried, ...]:
        """Each choice once, those that turn the trial again under other noise; the likeliest cause first."""
        return tuple(sorted((self._tried(name, away) for name, away in choices), key=_order))

    def _tried(self, name: str, away: tuple[str, ...]) -> Tried:
        own = self.once(f"without {name}", away)
        ends, sure = [own], 0.0
        if own.success:
            for first in range(0, ROUND * ROUNDS, ROUND):
                seeds = self._seeds[first : first + ROUND]
                ends += [self.once(f"without {name}, other noise", away, seed) for seed in seeds]
                if len(self._control) <= first:
                    self._control += [self.once("other noise alone", (), seed).success for seed in seeds]
                won, of = sum(end.success for end in ends[1:]), len(ends) - 1
                sure = surely_more(won, of, sum(self._control[:of]), of)
                if not OPEN < sure < SURE:
                    break
        won = sum(end.success for end in ends[1:])
        return Tried(name, away, own.success, won, len(ends) - 1, float(np.mean([end.error_m for end in ends])), sure)


def _order(tried: Tried) -> tuple:
    return not tried.explains, not tried.turned, -tried.chance, tried.error_m


def surely_more(won: int, of: int, control_won: int, control_of: int) -> float:
    """The probability that one chance is larger than another, each with Jeffreys' prior and so many successes."""
    density = beta.pdf(CHANCES, won + 0.5, of - won + 0.5)
    return float((density * beta.cdf(CHANCES, control_won + 0.5, control_of - control_won + 0.5)).sum() / density.sum())
