"""Why a trial failed, by simulating it again without some of its robot's effects: policy in the loop, every noise the same.

Each number by chance is a function of noise seed, step and channel (``effects/noise.py``), and each effect draws from channels of
its own, so that taking one away leaves all others' noise as it was. A single replay that succeeds says little where a policy is
chaotic. What turned the trial is therefore tried again under other seeds of the noise, beside the unchanged robot under the same
seeds: the control. Replays are simulated together, one row each: the same bits as alone, and the policy's process is asked once
in each control period for all of them.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Protocol

import numpy as np
from scipy.stats import beta

from api_schemas.policy import PolicyManifest
from sim_backend.driver.driver import Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import Tracker
from sim_backend.effects.causes import Cause, present
from sim_backend.effects.physics import Physics
from sim_backend.episode import Episode
from sim_backend.replays.comparison import shape_of_log
from sim_backend.replays.with_truth import changes_of, goal_of, start_of
from sim_backend.tasks import TASKS
from sim_backend.tasks.scoring import score
from sim_backend.tasks.task import Goal, Task
from sim_backend.trifinger.objects import Shape, resting_height_m
from trial_logs.reader import TrialLog, TruthLog

ROUND = 4
"""Replays with other noise at a time; a second round follows where the first leaves it open."""
ROUNDS = 2
SURE = 0.95
"""So likely must it be that the trial succeeds more often without the effect than with it, where one choice is tried again.

Of k choices that are tried again each has its share of what is left to chance: 1 - (1 - SURE) / k.
"""
OPEN = 0.6
OFTEN = 0.5
"""A cause makes the trial succeed at least so often; a trial whose control succeeds so often failed by chance."""
CHANCES = np.linspace(0.0005, 0.9995, 1000)


class InLoop(Protocol):
    """A policy that is asked again, for several trials at once; each has its own memory of it."""

    def most(self, observation_size: int) -> int:
        """So many trials may be under way together."""
        ...

    def begin(self, trials: int) -> None:
        """Forget all trials before; so many begin."""
        ...

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The actions (trials, 9) of observations (trials, size), float32."""
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

    def without(self, away: Sequence[str] = (), noise_seed: int | None = None) -> "Again":
        """The trial without some effects, under its own noise or that of another seed.

        An object that is of another size without them still lies on the table.
        """
        physics, start = self.physics.without(away), self.start
        changes = tuple((step, each.without(away)) for step, each in self.changes)
        factor, other = self.physics.value("cube_size.factor"), physics.value("cube_size.factor")
        position_m = start.cube_position_world_m.copy()
        if other != factor:
            position_m[:, 2] += resting_height_m(self.shape, start.cube_quat_wxyz) * other * (1.0 - factor / other)
        seed = start.noise_seed if noise_seed is None else np.array([noise_seed])
        start = replace(start, cube_position_world_m=position_m, noise_seed=seed)
        return replace(self, start=start, physics=physics, changes=changes)


@dataclass(frozen=True)
class End:
    """How a replay ended: whether at the goal, and how far from it, m (infinite where the physics became unstable)."""

    success: bool
    error_m: float


def ends(trials: Sequence[Again], policy: InLoop) -> list[End]:
    """How trials of one task, manifest and shape end, as many of them at a time as the policy takes."""
    most = policy.most(trials[0].manifest.observation_size) if trials else 1
    together = [trials[first : first + most] for first in range(0, len(trials), most)]
    return [end for some in together for end in _simulated(some, policy)]


def _simulated(trials: Sequence[Again], policy: InLoop) -> list[End]:
    one, now = trials[0], [trial.physics for trial in trials]
    physics, goal = Physics.stack(now), goals(trials)
    driver = SimulatedDriver(robots=len(trials), physics=physics, shape=one.shape, divergence_ends=False)
    tracker = Tracker(physics=physics, shape=one.shape)
    episode = Episode(driver, tracker, one.manifest)
    changes = sorted(((step, row, each) for row, trial in enumerate(trials) for step, each in trial.changes), key=lambda c: c[:2])
    policy.begin(len(trials))
    episode.begin(starts(trials), goal)
    for _ in range(one.task.steps // one.manifest.period_steps):
        if changes and changes[0][0] <= episode.step:
            while changes and changes[0][0] <= episode.step:
                _, row, now[row] = changes.pop(0)
            driver.set_physics(Physics.stack(now))
            tracker.set_physics(Physics.stack(now))
        observation = episode.observe().astype(np.float32)
        observation[driver.diverged] = 0.0
        episode.advance(policy.act(observation))
    state, diverged = episode.measurement, driver.diverged
    ended = (state.cube_position_world_m, state.cube_quat_wxyz, state.true_joint_position_rad)
    scores = score(one.task, goal, *ended)
    found = zip(scores.success.tolist(), scores.position_error_m.tolist(), diverged.tolist(), strict=True)
    return [End(False, math.inf) if is_lost else End(success, error_m) for success, error_m, is_lost in found]


def starts(trials: Sequence[Again]) -> Start:
    """The starts of all; noise of seed 0, and cold motors, where nothing else is said."""
    starts = [trial.start for trial in trials]
    seeds = [np.zeros(1, dtype=np.int64) if each.noise_seed is None else each.noise_seed for each in starts]
    rises = [np.zeros((1, 9)) if each.motor_temperature_rise_k is None else each.motor_temperature_rise_k for each in starts]
    return Start(
        np.concatenate([each.joint_position_rad for each in starts]),
        np.concatenate([each.cube_position_world_m for each in starts]),
        np.concatenate([each.cube_quat_wxyz for each in starts]),
        np.concatenate(seeds),
        np.concatenate(rises),
    )


def goals(trials: Sequence[Again]) -> Goal:
    """The goals of all."""
    names = [field.name for field in fields(Goal)]
    return Goal(**{name: np.concatenate([getattr(trial.goal, name) for trial in trials]) for name in names})


@dataclass(frozen=True)
class Tried:
    """What came of replays without ``away``: ``turned`` under the trial's own noise, then so many of so many successes.

    ``error_m`` is the mean distance from the goal at the end, ``sure`` the probability that it succeeds more often than the
    control, and ``needed`` how large that must be.
    """

    name: str
    away: tuple[str, ...]
    turned: bool
    successes: int
    replays: int
    error_m: float
    sure: float
    needed: float = SURE

    @property
    def chance(self) -> float:
        """The share of successes under other noise; of the one replay where there were no others."""
        return self.successes / self.replays if self.replays else float(self.turned)

    @property
    def explains(self) -> bool:
        """Whether it is blamed."""
        return self.turned and self.replays > 0 and self.sure >= self.needed and self.chance >= OFTEN


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
    everything = tuple(name for cause in trial.causes for name in cause.effects)
    ideal, *groups = search.tried([("no effect at all", everything), *((cause.name, cause.effects) for cause in trial.causes)])
    may_blame = ideal.turned or (any(each.turned for each in groups) and search.succeeds_often(everything))
    groups = search.again(groups) if may_blame else tuple(sorted(groups, key=_order))
    blamed = [name for each in groups if each.explains for name in each.away]
    singles: tuple[Tried, ...] = ()
    if effects and blamed:
        alone = {each.away[0]: replace(each, name=each.away[0]) for each in groups if each.explains and len(each.away) == 1}
        several = search.again(search.tried([(name, (name,)) for name in blamed if name not in alone]))
        singles = tuple(sorted((*several, *alone.values()), key=_order))
    successes, replays = search.control
    verdict = _verdict(any(each.explains for each in groups), successes, replays, may_blame)
    return Explanation(verdict, successes, replays, End(ideal.turned, ideal.error_m), groups, singles, search.done)


def _verdict(is_explained: bool, successes: int, replays: int, ideal_succeeds: bool) -> Verdict:
    if is_explained:
        return Verdict.CAUSE
    if replays and successes / replays >= OFTEN:
        return Verdict.CHANCE
    return Verdict.TOGETHER if ideal_succeeds else Verdict.POLICY


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

    def tried(self, choices: Sequence[tuple[str, tuple[str, ...]]]) -> list[Tried]:
        """Each choice once, under the trial's own noise."""
        found = self._ends(
            [self._trial.without(away) for _, away in choices], f"without {', '.join(name for name, _ in choices)}"
        )
        return [Tried(*choice, end.success, 0, 0, end.error_m, 0.0) for choice, end in zip(choices, found, strict=True)]

    def again(self, tried: Sequence[Tried]) -> tuple[Tried, ...]:
        """Those that turned the trial again under other noise, beside the control; the likeliest cause first."""
        needed = 1 - (1 - SURE) / max(sum(each.turned for each in tried), 1)
        known = [replace(each, needed=needed) for each in tried]
        for first in range(0, ROUND * ROUNDS, ROUND):
            left = [at for at, each in enumerate(known) if each.turned and (not first or OPEN < each.sure < needed)]
            if not left:
                break
            for at, found in zip(left, self._round([known[at] for at in left], first), strict=True):
                known[at] = found
        return tuple(sorted(known, key=_order))

    def succeeds_often(self, away: tuple[str, ...]) -> bool:
        """Whether a choice that did not turn the trial succeeds under other noise; what fails without any effect blames none."""
        return self._round([Tried("no effect at all", away, False, 0, 0, 0.0, 0.0)], 0)[0].chance >= OFTEN

    def _round(self, tried: Sequence[Tried], first: int) -> list[Tried]:
        """One more round of replays under other noise of each choice, and of the control unless it has them."""
        seeds = self._seeds[first : first + ROUND]
        of_control = [self._trial.without((), seed) for seed in seeds] if len(self._control) <= first else []
        rows = [self._trial.without(each.away, seed) for each in tried for seed in seeds]
        found = self._ends([*of_control, *rows], f"other noise without {', '.join(each.name for each in tried)}")
        self._control += [end.success for end in found[: len(of_control)]]
        found = found[len(of_control) :]
        return [self._with(each, found[ROUND * at : ROUND * (at + 1)]) for at, each in enumerate(tried)]

    def _with(self, tried: Tried, found: Sequence[End]) -> Tried:
        won, of = tried.successes + sum(end.success for end in found), tried.replays + len(found)
        error_m = ((1 + tried.replays) * tried.error_m + sum(end.error_m for end in found)) / (1 + of)
        sure = surely_more(won, of, sum(self._control[:of]), of)
        return replace(tried, successes=won, replays=of, error_m=error_m, sure=sure)

    def _ends(self, trials: Sequence[Again], what: str) -> list[End]:
        if not trials:
            return []
        self._told(f"{len(trials)} replays, {what}", self.done)
        found = ends(trials, self._policy)
        self.done += len(found)
        return found


def _order(tried: Tried) -> tuple:
    return not tried.explains, not tried.turned, -tried.chance, tried.error_m


def surely_more(won: int, of: int, control_won: int, control_of: int) -> float:
    """The probability that one chance is larger than another, each with Jeffreys' prior and so many successes."""
    density = beta.pdf(CHANCES, won + 0.5, of - won + 0.5)
    return float((density * beta.cdf(CHANCES, control_won + 0.5, control_of - control_won + 0.5)).sum() / density.sum())
