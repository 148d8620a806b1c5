"""Causes at a cube that act at once, found one after the other.

Pushes are replayed with what is known of the robot; the hypothesis that gains most beside those accepted is added, the numbers of
all are fitted together, and pushes are replayed again with them, until none gains enough and none moves any more. Replays that
are near the truth show what a single look at nominal pushes hides: table friction that is half of what it should be makes a cube
seem light, and fingertips slippery.

What joints are still off by forces pushes, too. How sessions of such robots scatter says what is more than chance and how sure a
number is; the scatter of healthy ones, which is smaller, leads to where the numbers are, from afar.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np

from sim_backend.reality_gap.knowledge.cube import NUMBERS_OF_PUSHES, UNTOLD_BESIDE_OTHERS
from sim_backend.reality_gap.quantiles import Z_90
from sim_backend.reality_gap.subjects.cube.hypotheses import Estimate, Null, WhitenedSession, whitened, without_worst
from sim_backend.reality_gap.subjects.cube.push_numbers import Fitted, PushNumber, fitted, numbers_of
from sim_backend.reality_gap.subjects.cube.replayed_robot import ReplayedRobot, absent_values
from sim_backend.reality_gap.subjects.cube.summary import CubeEvidence, CubeSummary, summary_of_evidence
from sim_backend.reality_gap.subjects.subject import Progress, part

MOST_ROUNDS = 12
_SETTLING = 4
"""Replays about where the numbers are, once nothing is added: contacts are far from linear, and each gives them a little
differently."""
_LESS = 0.5
"""Share of a move that is made meanwhile: whole ones go to and fro."""
_RIVALS, _CLOSE = 2, 0.7
"""So many effects are tried as the first one, if they gain this share of what the best one gains."""
_PRICE = 5.0
"""Nats that an effect costs where such ways are compared: odds of 150."""


@dataclass(frozen=True)
class Scatter:
    """How sessions with nothing wrong with the cube scatter.

    Attributes:
        healthy: where nothing else is wrong, either.
        here: where joints are off as much as those of this robot may still be.
    """

    healthy: Null
    here: Null


@dataclass(frozen=True)
class Several:
    """What pushes show of a cube.

    Attributes:
        estimates: of effects that are clear, in the order in which they were accepted; standard errors are beside all others.
        session: what a replay with these values leaves, whitened.
        summary: the same as it is.
        first: what replays with none of them leave, whitened.
    """

    estimates: tuple[Estimate, ...]
    session: WhitenedSession
    summary: CubeSummary
    first: WhitenedSession

    @classmethod
    def without_pushes(cls, evidence: CubeEvidence, null: Null) -> "Several":
        """Nothing, of a session in which too few pushes were seen."""
        summary = summary_of_evidence(evidence)
        session = whitened(summary, null)
        return cls((), session, summary, session)


def one_after_the_other(
    evidence_with: Callable[[ReplayedRobot], CubeEvidence],
    base: ReplayedRobot,
    scatter: Scatter,
    is_enough: Callable[[float], bool],
    progress: Progress = lambda *_: None,
) -> Several:
    """The effects that pushes need, with their numbers.

    Args:
        evidence_with: replays the pushes with a base; at least one.
        base: the robot as far as it is known.
        scatter: of sessions.
        is_enough: whether a gain in nats is more than chance.
        progress: told what is done, and which share at least.
    """
    search = _Search(evidence_with, scatter, is_enough)
    first = search.replayed(base, ())
    firsts = first.firsts(is_enough)
    if not firsts:
        return Several((), first.here.session, first.summary, first.here.session)
    shares = np.linspace(0.0, 1.0, len(firsts) + 1)
    parts = [part(progress, *between) for between in pairwise(shares.tolist())]
    ends = [search.settled(first, effect, own) for effect, own in zip(firsts, parts, strict=True)]
    estimates = _estimates(min(ends, key=lambda rounds: np.mean([each.price for each in rounds])))
    for effect, own in groupby(estimates, key=lambda row: row.effect):
        base = base.with_values(effect, np.array([row.value for row in own]))
    last = search.replayed(base, tuple(dict.fromkeys(row.effect for row in estimates)))
    return Several(estimates, last.here.session, last.summary, first.here.session)


def _estimates(rounds: Sequence["_Round"]) -> tuple[Estimate, ...]:
    """The numbers in the mean of rounds with the same effects; of effects that are clear."""
    last, found = rounds[-1], []
    values, std = (np.array([getattr(each, name)() for each in rounds]) for name in ("values", "errors"))
    mean, error = values.mean(axis=0), np.sqrt((std**2).mean(axis=0) + values.var(axis=0) / len(rounds))
    numbers = iter(zip(mean, error, strict=True))
    for effect in last.accepted:
        own = [
            Estimate(effect, parameter, where, float(value), unit, float(off))
            for (parameter, where, unit), (value, off) in zip(NUMBERS_OF_PUSHES[effect], numbers, strict=False)
        ]
        if any(abs(row.value - at) > Z_90 * row.std for row, at in zip(own, absent_values(effect), strict=True)):
            found += own
    return tuple(found)


@dataclass(frozen=True)
class _Search:
    """How replays are made, and when one is the last."""

    evidence_with: Callable[[ReplayedRobot], CubeEvidence]
    scatter: Scatter
    is_enough: Callable[[float], bool]

    def replayed(self, base: ReplayedRobot, accepted: tuple[str, ...]) -> "_Round":
        evidence = without_worst(self.evidence_with(base), self.scatter.healthy)
        summary = summary_of_evidence(evidence)
        seen = (_Seen.of(summary, null, base) for null in (self.scatter.healthy, self.scatter.here))
        return _Round(base, accepted, summary, *seen)

    def settled(self, first: "_Round", effect: str, progress: Progress) -> list["_Round"]:
        """Replays about where the numbers are, with all effects that are needed if this one is the first."""
        accepted, now, found = (effect,), first, list[_Round]()
        for done in range(MOST_ROUNDS):
            progress(f"replaying pushes with {', '.join(accepted)}", done / MOST_ROUNDS)
            now = self.replayed(now.moved(accepted, 1.0 if accepted != now.accepted else _LESS), accepted)
            if added := now.best_beside(self.is_enough):
                accepted, found = (*accepted, added), []
            else:
                found.append(now)
            if len(found) == _SETTLING:
                break
        return found or [now]


@dataclass(frozen=True)
class _Seen:
    """A replay's summary as seen by a scatter of sessions: whitened, with the numbers of each hypothesis by effect."""

    session: WhitenedSession
    numbers: Mapping[str, tuple[PushNumber, ...]]

    @classmethod
    def of(cls, summary: CubeSummary, null: Null, base: ReplayedRobot) -> "_Seen":
        session = whitened(summary, null)
        return cls(session, numbers_of(summary, session, base))

    def fit(self, effects: Sequence[str]) -> Fitted:
        return fitted(self.session.vector, [number for effect in effects for number in self.numbers[effect]])

    def gains(self, accepted: Sequence[str]) -> dict[str, float]:
        """What each other effect gains beside those accepted, nats, less one for each further number."""
        before = self.fit(accepted).half_left
        others = {effect: len(numbers) for effect, numbers in self.numbers.items() if effect not in accepted}
        return {effect: before - self.fit((*accepted, effect)).half_left - (n - 1) for effect, n in others.items()}


@dataclass(frozen=True)
class _Round:
    """One replay: the base, the effects that it has, and what is left, as seen by both scatters."""

    base: ReplayedRobot
    accepted: tuple[str, ...]
    summary: CubeSummary
    healthy: _Seen
    here: _Seen

    @property
    def price(self) -> float:
        """What the replay leaves, nats, and what accepted effects cost: each of them, its size, and each further number."""
        numbers = [number for effect in self.accepted for number in self.here.numbers[effect]]
        sizes, further = np.array([number.sizes[number.rest] for number in numbers]), len(numbers) - len(self.accepted)
        left = self.here.session.vector
        return 0.5 * float(left @ left + sizes @ sizes) + _PRICE * len(self.accepted) + further

    def able(self, is_enough: Callable[[float], bool]) -> dict[str, float]:
        """Effects that gain more than chance beside those accepted, the largest gain by the scatter of healthy sessions first."""
        by_healthy = self.healthy.gains(self.accepted)
        gains = self.here.gains(self.accepted).items()
        able = [effect for effect, gain in gains if is_enough(gain) and effect not in UNTOLD_BESIDE_OTHERS]
        return {effect: by_healthy[effect] for effect in sorted(able, key=lambda effect: -by_healthy[effect])}

    def firsts(self, is_enough: Callable[[float], bool]) -> list[str]:
        """The effects that may be the first one: the best, and what comes close."""
        able = self.able(is_enough)
        close = [effect for effect, gain in able.items() if gain >= _CLOSE * max(able.values())]
        return close[:_RIVALS]

    def best_beside(self, is_enough: Callable[[float], bool]) -> str:
        """The effect to be added, "" if none gains more than chance."""
        return next(iter(self.able(is_enough)), "")

    def moved(self, effects: Sequence[str], share: float) -> ReplayedRobot:
        """The base with the numbers of effects nearer to where they fit best together."""
        return self._moved(self.healthy, effects, share)

    def values(self) -> np.ndarray:
        """The numbers of the accepted effects, where all effects, these first, fit best together."""
        base = self._moved(self.here, self._all, 1.0)
        return np.concatenate([base.values(effect) for effect in self.accepted] or [np.zeros(0)])

    def errors(self) -> np.ndarray:
        """Their standard errors, while those of all effects may be as far off as they usually are."""
        units = np.array([self.base.unit_of(effect) for effect in self.accepted for _ in self.here.numbers[effect]])
        return self.here.fit(self._all).std[: len(units)] * units

    @property
    def _all(self) -> tuple[str, ...]:
        return (*self.accepted, *(effect for effect in self.here.numbers if effect not in self.accepted))

    def _moved(self, seen: _Seen, effects: Sequence[str], share: float) -> ReplayedRobot:
        base, fit = self.base, seen.fit(effects)
        moves = iter(share * (fit.values - fit.rests))
        for effect in effects:
            base = base.moved(effect, [next(moves) for _ in seen.numbers[effect]])
        return base
