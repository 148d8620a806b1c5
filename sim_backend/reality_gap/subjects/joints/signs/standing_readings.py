"""Readings that stand still now and then while the joint moves on, and then catch up within one row: seen without any fit.

A joint that stops has to be made faster again, by torques that its model knows. A reading that stands still is right again at
once, as far on as it would have come.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.measured.sensor_noise import white_noise
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.verdict import EffectJudged, Told, Verdict, VerdictKind

_AROUND = 3
"""Rows before and after, whose moves say how fast the joint is."""
_FAST = 17.0
"""Times an encoder's noise that a joint must move from row to row."""
_STANDS, _CAUGHT_UP = 0.25, 0.35
"""Share of that move below which a reading stands still, and of the way that it missed within which it catches up."""
_LONG, _LONG_ALONE = 2, 3
"""Rows: one that is written twice is a message that was late, as many tables have. Of an arm of one joint nobody else says so."""
_LEAST = 3
"""Times at one joint: hits of a gear with play look like it once in a while."""
_SLOWEST_S = 0.01
"""Between rows: those of a faster recording are looked at this far apart, too."""
_SOMETIMES = 0.05
"""Share of the rows in which the joint is fast: what stands still more often is sampled more slowly than it is written."""


@dataclass(frozen=True)
class StandingReading:
    """An encoder's: the joint's name, how often it stood still, and for how long at most, s."""

    joint: str
    times: int
    longest_s: float


def against_standing_readings(verdict: Verdict, episodes: Sequence[EpisodeEquations], names: Sequence[str]) -> Verdict:
    """A verdict as it stands beside readings that stood still: the catalogue has no such effect, whatever else is there."""
    found = standing_readings(episodes, names)
    if not found or verdict.verdict is VerdictKind.NOT_IDENTIFIABLE:
        return verdict
    said = "; ".join(
        f"the encoder of {each.joint} stood still {each.times} times, for up to {1e3 * each.longest_s:.2g} ms, and then caught up"
        for each in found
    )
    return replace(
        verdict,
        verdict=VerdictKind.UNEXPLAINED,
        summary=f"While the robot moved on {said}: the catalogue has no such effect. {verdict.summary}",
        record_next=tuple(dict.fromkeys((*verdict.record_next, "the encoder's cable moved by hand while the joint turns"))),
        effects=tuple(
            EffectJudged(each.effect, Told.NOT_JUDGED, because="readings that stood still may hide it or look like it")
            if each.told in (Told.NAMED, Told.CONFUSABLE)
            else each
            for each in verdict.effects
        ),
    )


def standing_readings(episodes: Sequence[EpisodeEquations], names: Sequence[str]) -> list[StandingReading]:
    """Encoders that stood still by themselves: rows that are written twice stand still at all joints that move.

    Of a fast recording every second row is looked at, too, every fourth and so on: from one of its rows to the next a slow joint
    does not move by more than its noise.

    Args:
        episodes: of a study.
        names: of its joints.
    """
    fastest_s, found = min(episode.path.step_s for episode in episodes), dict[str, StandingReading]()
    for power in range(int(np.log2(max(1.0, _SLOWEST_S / fastest_s))) + 1):
        for each in _standing(episodes, names, 2**power):
            if each.joint not in found or each.times > found[each.joint].times:
                found[each.joint] = each
    return [found[name] for name in names if name in found]


def _standing(episodes: Sequence[EpisodeEquations], names: Sequence[str], every: int) -> list[StandingReading]:
    """Those of some of the rows: ``every`` second one, for instance."""
    times, longest_s, fast = np.zeros(len(names), int), np.zeros(len(names)), np.zeros(len(names), int)
    for episode in episodes:
        positions, step_s = episode.path.joints.position_rad, episode.path.step_s
        noise = np.maximum(white_noise(positions), episode.path.encoder_step_rad / np.sqrt(12.0))
        positions, step_s = positions[::every], every * step_s
        moves = np.diff(positions, axis=0)
        is_fast = [_is_fast(own, own_noise) for own, own_noise in zip(moves.T, noise, strict=True)]
        stood = [_stood(own, own_fast) for own, own_fast in zip(moves.T, is_fast, strict=True)]
        for j, own in enumerate(stood):
            fast[j] += int(is_fast[j].sum())
            for begin, rows in own.items():
                if rows < (_LONG if len(names) > 1 else _LONG_ALONE):
                    continue
                others = [begin in stood[k] for k in range(len(names)) if k != j and is_fast[k][begin]]
                if not any(others):
                    times[j] += 1
                    longest_s[j] = max(longest_s[j], rows * step_s)
    seen = np.flatnonzero((times >= _LEAST) & (times < _SOMETIMES * fast))
    return [StandingReading(names[j], int(times[j]), float(longest_s[j])) for j in map(int, seen)]


def _before(moves: np.ndarray) -> np.ndarray:
    """Mean of the moves before each one, shape (s,); nothing before the first ones."""
    found = np.zeros(len(moves))
    if len(moves) > _AROUND:
        found[_AROUND:] = np.convolve(moves, np.ones(_AROUND) / _AROUND, "valid")[:-1]
    return found


def _is_fast(moves: np.ndarray, noise_rad: float) -> np.ndarray:
    """Where a joint was so fast just before that a reading cannot stand still, shape (s,); not beside what is missing."""
    with np.errstate(invalid="ignore"):
        return np.abs(_before(moves)) > _FAST * noise_rad


def _stood(moves: np.ndarray, is_fast: np.ndarray) -> dict[int, int]:
    """Where a reading stood still and then caught up: for how many rows, by the first of them."""
    found, last, speed = dict[int, int](), -1, _before(moves)
    with np.errstate(invalid="ignore"):
        begins = np.flatnonzero(is_fast & (np.abs(moves) <= _STANDS * np.abs(speed)))
    for begin in map(int, begins):
        if begin <= last:
            continue
        before, last = speed[begin], begin
        while last < len(moves) and abs(moves[last]) <= _STANDS * abs(before):
            last += 1
        after = moves[last + 1 : last + 1 + _AROUND]
        if len(after) < _AROUND or not np.isfinite(moves[begin - _AROUND : last + 1 + _AROUND]).all():
            continue
        speeds = np.array([before, after.mean()])
        missed = speeds.mean() * (last - begin + 1)
        is_steady = speeds[0] * speeds[1] > 0.0 and 0.5 < speeds[1] / speeds[0] < 2.0
        if is_steady and abs(moves[last] - missed) < _CAUGHT_UP * abs(missed):
            found[begin] = last - begin
    return found
