"""How healthy sessions with a cube scatter, what the largest gain is that chance gives, and what can be detected at all.

``python -m sim_backend.reality_gap.bench.cube_calibration --sessions N --seed S --out FILE`` simulates healthy robots and writes
the table that studies read; the one of the package is ``knowledge/healthy_cubes.json``, with its seeds.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sim_backend.reality_gap.bench.cube_limits import GAUSSIAN_CRITICAL, detection_limits, told_scores
from sim_backend.reality_gap.bench.cube_sessions import healthy_physics, sessions_with_pushes
from sim_backend.reality_gap.knowledge.cube import COUNTED, KINDS, Count, Kind
from sim_backend.reality_gap.quantiles import MEDIAN_SIZE
from sim_backend.reality_gap.subjects.cube.contact import CONTACT_NAMES
from sim_backend.reality_gap.subjects.cube.healthy import PACKAGED, HealthyCubes
from sim_backend.reality_gap.subjects.cube.hypotheses import Null, without_worst
from sim_backend.reality_gap.subjects.cube.replay import PushReplay
from sim_backend.reality_gap.subjects.cube.summary import (
    NAMES,
    PLACED_NAMES,
    CubeEvidence,
    CubeSummary,
    evidence_of,
    summary_of_evidence,
)
from sim_backend.reality_gap.subjects.cube.support import supported
from sim_backend.refusal import refused
from sim_backend.workers.pool import Workers, WorkersError, open_workers

GROUP = 20
"""Sessions that are simulated at once."""
_FOLDS = 10
_JUMPS = next(row for row in COUNTED if row.count is Count.JUMPS)
_SHRINK = 0.2  # of the covariance towards its diagonal: there are few sessions for each number
_FLOOR_STD = {"delay_s": 2e-4, "log_interval": 0.003, "confidence": 0.002, "rest_height_m": 5e-5}
_WINSOR = 5.0  # robust standard deviations beyond which a healthy session's number counts as at that distance


def calibrate(
    sessions: Sequence[CubeEvidence], jump_probabilities: Sequence[float], seeds: Sequence[tuple[int, int]]
) -> HealthyCubes:
    """The table from healthy sessions.

    Args:
        sessions: what they leave to judge.
        jump_probabilities: that their robots had.
        seeds: first seed and number of each group of them.
    """
    whole = fit_null([summary_of_evidence(row) for row in sessions], jump_probabilities)
    kept = [summary_of_evidence(without_worst(row, whole)) for row in sessions]
    told = _judged_apart(sessions, kept, jump_probabilities, 1.0).told
    pushed = [critical for name, critical in _critical(told).items() if name.partition(".")[0] in KINDS[Kind.PUSHES]]
    breadth = max(1.0, float(np.median(pushed)) / GAUSSIAN_CRITICAL) ** 2
    apart = _judged_apart(sessions, kept, jump_probabilities, breadth)
    null = fit_null(kept, jump_probabilities, breadth)
    summaries = [summary_of_evidence(without_worst(row, null)) for row in sessions]
    limits = detection_limits(summaries, null, _critical(apart.told))
    gains = {kind: np.sort([row[kind] for row in apart.gains]) for kind in KINDS}
    peaks = {kind: np.sort([row[kind] for row in apart.peaks if kind in row]) for kind in (Kind.TRACKER, Kind.PUSHES)}
    return HealthyCubes(null, gains, np.sort(apart.push_gains), np.sort(apart.misfits), peaks, limits, tuple(seeds))


@dataclass
class _Apart:
    """Of each session largest gains, and without any one push; misfit per number, farthest numbers, and what told tests see."""

    gains: list[dict[Kind, float]] = field(default_factory=list)
    push_gains: list[float] = field(default_factory=list)
    misfits: list[float] = field(default_factory=list)
    peaks: list[dict[Kind, float]] = field(default_factory=list)
    told: dict[str, list[float]] = field(default_factory=dict)


def _judged_apart(
    sessions: Sequence[CubeEvidence], kept: Sequence[CubeSummary], jump_probabilities: Sequence[float], breadth: float
) -> _Apart:
    """What is seen of each session by a scatter measured on other sessions."""
    folds = np.arange(len(sessions)) % _FOLDS
    apart = _Apart()
    for fold in range(_FOLDS):
        others = np.flatnonzero(folds != fold).tolist()
        without = fit_null([kept[i] for i in others], [jump_probabilities[i] for i in others], breadth)
        for i in np.flatnonzero(folds == fold).tolist():
            evidence = without_worst(sessions[i], without)
            seen = supported(evidence, without)
            apart.gains.append(seen.gains())
            apart.push_gains.append(seen.push_gain())
            apart.misfits.append(seen.misfit())
            apart.peaks.append(seen.peaks())
            for name, scores in told_scores(summary_of_evidence(evidence), without).items():
                apart.told.setdefault(name, []).extend(np.abs(scores))
    return apart


def _critical(told: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Scores beyond which 1 % of healthy sessions lie, at least those of Gaussian noise."""
    return {name: max(GAUSSIAN_CRITICAL, float(np.quantile(scores, 0.99))) for name, scores in told.items()}


def fit_null(summaries: Sequence[CubeSummary], jump_probabilities: Sequence[float], breadth: float = 1.0) -> Null:
    """Mean and covariance over healthy sessions with pushes, and what is usual of gaps and jumps over all.

    Args:
        summaries: of healthy sessions.
        jump_probabilities: that their robots had.
        breadth: factor on the covariance of what pushes show, which has broader tails than a Gaussian.
    """
    vectors = np.array([row.vector for row in summaries])
    vectors = vectors[np.isfinite(vectors).all(axis=1)]
    middle = np.median(vectors, axis=0)
    spread = np.median(np.abs(vectors - middle), axis=0) / MEDIAN_SIZE + 1e-12
    floor = np.array([_FLOOR_STD.get(name, 0.0) for name in NAMES])
    vectors = np.clip(vectors, middle - _WINSOR * np.maximum(spread, floor), middle + _WINSOR * np.maximum(spread, floor))
    covariance = np.cov(vectors.T) * _related()
    covariance = (1.0 - _SHRINK) * covariance + _SHRINK * np.diag(np.diag(covariance)) + np.diag(floor**2)
    broader = np.array([breadth**0.5 if name in CONTACT_NAMES else 1.0 for name in NAMES])
    covariance *= np.outer(broader, broader)
    trackers = [(row.tracker, p) for row, p in zip(summaries, jump_probabilities, strict=True) if row.tracker is not None]
    gaps, jumps = (
        np.array([[t.gaps, t.frames + t.lost] for t, _ in trackers]),
        np.array([[t.jumps, t.jump_frames] for t, _ in trackers]),
    )
    expected = sum(p * t.jump_frames for t, p in trackers)
    return Null(
        mean=vectors.mean(axis=0),
        covariance=covariance,
        gap_mean=float(gaps[:, 0].sum() / gaps[:, 1].sum()),
        gap_variance=_dispersion(gaps[:, 0]),
        jump_mean=float(jumps[:, 0].sum() / jumps[:, 1].sum()),
        jump_variance=_dispersion(jumps[:, 0]),
        jump_share=float(jumps[:, 0].sum() / expected) if expected > 0 else 1.0,
    )


def _related() -> np.ndarray:
    """Which numbers may scatter together, shape (k, k) of 0 and 1: those of pushes and the height of rest; no others."""
    pushed = np.array([name in PLACED_NAMES for name in NAMES])
    return np.where(np.outer(pushed, pushed), 1.0, np.eye(len(NAMES)))


def _dispersion(counts: np.ndarray) -> float:
    return float(max(counts.var() / counts.mean(), 1.0)) if counts.mean() > 0 else 1.0


class SimulateHealthy:
    """What a worker does: healthy sessions from the first seed on, each with its robot's probability of a jump."""

    def __init__(self) -> None:
        self._replay = PushReplay()

    def __call__(self, seeds: range, _: None = None) -> list[tuple[CubeEvidence, float]]:
        """Of each seed; all are simulated at once."""
        physics = healthy_physics(np.random.default_rng([seeds[0]]), len(seeds))
        sessions = sessions_with_pushes(physics, list(seeds))
        jumps = physics.value(_JUMPS.key)
        return list(zip(evidence_of(sessions, self._replay), map(float, jumps), strict=True))


def healthy_evidence(seeds: range, workers: Workers, progress: Callable[[str], None]) -> Iterator[tuple[CubeEvidence, float]]:
    """Healthy sessions, by workers that do :class:`SimulateHealthy`, ``GROUP`` at once."""
    begun, done = time.monotonic(), 0
    for group in workers.map([seeds[i : i + GROUP] for i in range(0, len(seeds), GROUP)]):
        yield from group
        done += len(group)
        left_s = (time.monotonic() - begun) / done * (len(seeds) - done)
        progress(f"{done} of {len(seeds)} healthy sessions, {left_s / 60:.0f} min left")


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(prog="python -m sim_backend.reality_gap.bench.cube_calibration", description=__doc__)
    parser.add_argument("--sessions", type=int, default=400)
    parser.add_argument("--seed", type=int, default=760000, help="of the first session")
    parser.add_argument("--out", type=Path, default=PACKAGED)
    parser.add_argument("--processes", type=int, default=2, metavar="N", help="that work side by side (%(default)s)")
    parser.add_argument("--cluster", metavar="ADDRESS", help="Ray that has the processes: local, or HOST:PORT")
    options = parser.parse_args(arguments)
    seeds = range(options.seed, options.seed + options.sessions)
    try:
        with open_workers(SimulateHealthy, options.processes, options.cluster) as workers:
            rows = list(healthy_evidence(seeds, workers, lambda text: print(text, file=sys.stderr)))
    except WorkersError as error:
        return refused(error, as_json=False)
    table = calibrate([row for row, _ in rows], [p for _, p in rows], [(options.seed, options.sessions)])
    options.out.write_text(json.dumps(table.document(), indent=1) + "\n", encoding="utf-8")
    print(f"{len(rows)} healthy sessions; {options.out} written; detection limits {table.limits}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
