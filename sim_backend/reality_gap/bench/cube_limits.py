"""How small an effect on cube or tracker may be and still be detected: by a test that is told which one it is."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

from sim_backend.reality_gap.knowledge.cube import COUNTED, LINEAR, TABLED, Count
from sim_backend.reality_gap.quantiles import Z_99
from sim_backend.reality_gap.subjects.cube.counts import healthy_count
from sim_backend.reality_gap.subjects.cube.hypotheses import (
    FINE,
    Null,
    WhitenedSession,
    moved_by,
    response_table,
    seen_count,
    whitened,
)
from sim_backend.reality_gap.subjects.cube.summary import CubeSummary

GAUSSIAN_CRITICAL = Z_99
"""A test that is told effect, place and noise rejects at 1 % beyond so many standard deviations, were the noise Gaussian."""


def told_scores(summary: CubeSummary, null: Null) -> dict[str, list[float]]:
    """What tests that are told the effect see in a session, in standard deviations, by effect (and side).

    For effects with several numbers one score for each of them; without pushes none for what only pushes show.
    """
    seen, scores = whitened(summary, null), {}
    for name, ways in _told_ways(summary, seen).items():
        size = np.linalg.norm(ways, axis=1)
        scores[name] = [float(way @ seen.vector / length) for way, length in zip(ways, size, strict=True) if length > 1e-12]
    return scores


def detection_limits(summaries: Sequence[CubeSummary], null: Null, critical: Mapping[str, float]) -> dict[str, float]:
    """By effect (and side): the deviation from nominal that a test told effect, place and noise detects in half of the sessions.

    Median over the sessions with pushes of the size at which the expected score is the critical one. For ``tracking_offset`` it
    is the length of the offset, root mean square over directions; for counts the probability at which a count is beyond
    the critical one in half of the sessions.

    Args:
        summaries: of healthy sessions.
        null: their scatter.
        critical: score beyond which 1 % of healthy sessions lie, by effect (and side).
    """
    limits: dict[str, list[float]] = {}
    for summary in (row for row in summaries if row.contact is not None):
        seen = whitened(summary, null)
        for name, ways in _told_ways(summary, seen).items():
            if "." not in name:
                strength = float(np.sqrt((ways**2).sum(axis=1).mean()))
                limits.setdefault(name, []).append(critical[name] / strength)
        for row in TABLED:
            for side, value in _sides(summary, seen, row.effect, critical):
                limits.setdefault(f"{row.effect}.{side}", []).append(value)
    found = {name: float(np.median(values)) for name, values in limits.items()}
    trackers = [row.tracker for row in summaries if row.tracker is not None]
    for row in COUNTED:
        seen = [seen_count(row.count, tracker, null) for tracker in trackers]
        lost = [tracker.lost if row.count is Count.LOST_FRAMES else 0 for tracker in trackers]
        frames = float(np.median(np.array([each.frames for each in seen]) - lost))
        found[row.effect] = _count_limit(seen[0].usual, seen[0].spread, frames) / seen[0].share
    return found


def _told_ways(summary: CubeSummary, seen: WhitenedSession) -> dict[str, np.ndarray]:
    """How one unit of each number moves the whitened vector, shape (numbers, k); of tabled effects just beside nominal."""
    ways = {row.effect: seen.of(np.stack([moved_by(row, i, summary) for i in range(len(row.parameters))])) for row in LINEAR}
    if summary.contact is not None:
        for row in TABLED:
            values, moves = response_table(summary, row.effect)
            nominal = int(np.flatnonzero(values == 1.0)[0])
            for side, k in (("down", nominal - 1), ("up", nominal + 1)):
                ways[f"{row.effect}.{side}"] = seen.of(moves[k : k + 1]) / abs(values[k] - 1.0)
    return ways


def _sides(summary: CubeSummary, seen: WhitenedSession, effect: str, critical: Mapping[str, float]) -> list[tuple[str, float]]:
    """How far below and above 1 a tabled effect must be for the critical score."""
    values, moves = response_table(summary, effect)
    fine = np.linspace(values[0], values[-1], 4 * FINE)
    ways = np.stack([np.interp(fine, values, column) for column in seen.of(moves).T], axis=1)
    size, found = np.linalg.norm(ways, axis=1), []
    for side, away in (("down", 1.0 - fine), ("up", fine - 1.0)):
        enough = away[(size >= critical[f"{effect}.{side}"]) & (away > 0.0)]
        found.append((side, float(enough.min()) if len(enough) else np.inf))
    return found


def _count_limit(usual: float, spread: float, frames: float) -> float:
    critical = float(healthy_count(max(usual * frames, 1e-3), spread).ppf(0.99))
    return float(stats.gamma.ppf(0.5, critical + 1.0) / frames)
