"""Errors of the nominal and of the better model on tosses that no fit has seen, with a noise floor, and what to draw of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_backend.reality_gap.subjects.tosses.evidence import MOTION, TossEvidence
from sim_backend.reality_gap.subjects.tosses.likelihood import by_episode
from sim_backend.reality_gap.subjects.tosses.replay import replayed
from sim_backend.reality_gap.subjects.tosses.stretches import Toss
from sim_backend.reality_gap.verdict import HeldOut

_HORIZONS = 12
_DRAWS = 1000


@dataclass(frozen=True)
class KindError:
    """Mean size of the residuals of one kind of evidence before and after, and of how many tosses."""

    name: str
    unit: str
    before: float
    after: float
    tosses: int


@dataclass(frozen=True)
class Confirmation:
    """Held-out errors.

    Attributes:
        held_out: of the motion (of the first kind of evidence there is, without motion); position errors as % of the width.
        width_m: of the object, to turn % into m.
        kinds: all kinds of evidence.
        unseen: whether these tosses were kept apart from every fit.
        horizon: error against time since the start, a section of ``study.json``.
        worst_window: the toss that the nominal model gets most wrong, a section of ``study.json``.
        ladder: error after each cause, a section of ``study.json``.
    """

    held_out: HeldOut
    width_m: float
    kinds: tuple[KindError, ...]
    unseen: bool
    horizon: Mapping[str, Any] | None
    worst_window: Mapping[str, Any] | None
    ladder: tuple[Mapping[str, Any], ...]

    @property
    def is_of_motion(self) -> bool:
        """Whether the errors are of replayed motion, which has a noise floor."""
        return self.horizon is not None


def confirmed(
    evidence: TossEvidence,
    rows: Sequence[int],
    steps: Sequence[tuple[str, Mapping[str, float]]],
    unseen: bool,
    rng: np.random.Generator,
) -> Confirmation:
    """Compare the first of some steps with the last.

    Args:
        evidence: of all tosses.
        rows: tosses to confirm with.
        steps: label and values: nominal first, then with one cause more each, the final values last.
        unseen: whether no fit has seen these tosses.
        rng: for bootstraps and for the noise floor.
    """
    residuals = [evidence.residuals(values, rows) for _, values in steps]
    first, last = residuals[0], residuals[-1]
    kinds = tuple(_kind_error(kind.name, kind.unit, first[kind.name], last[kind.name]) for kind in evidence.kinds)
    width_m, motion = evidence.replayer.geometry.width_m, MOTION in first
    name = MOTION if motion else kinds[0].name
    unit, factor = ("% of the width", 100.0) if motion else (kinds[0].unit, 1.0)
    drawn = _paths(evidence, rows, steps[0][1], steps[-1][1], rng) if motion else None
    floor = drawn.floor_m / width_m * 100.0 if drawn else evidence.kinds[0].scatter
    interval = _reduction_interval(first[name], last[name], evidence.episodes[list(rows)], rng)
    before, after = factor * float(np.nanmean(np.abs(first[name]))), factor * float(np.nanmean(np.abs(last[name])))
    reduction = 1.0 - after / before if before > 0.0 else 0.0
    metric = "mean position error of open-loop replays" if motion else kinds[0].name
    count = int(np.isfinite(first[name]).sum())
    held_out = HeldOut(metric, unit, before, after, floor, reduction, interval, count, is_unseen=unseen)
    ladder = tuple(
        {"label": label, "held_out": factor * float(np.nanmean(np.abs(residual[name]))), "unit": unit}
        for (label, _), residual in zip(steps, residuals, strict=True)
    )
    shown = (drawn.horizon, drawn.worst_window) if drawn else (None, None)
    return Confirmation(held_out, width_m, kinds, unseen, *shown, ladder)


def _kind_error(name: str, unit: str, before: np.ndarray, after: np.ndarray) -> KindError:
    mean = [float(np.nanmean(np.abs(values))) if np.isfinite(values).any() else float("nan") for values in (before, after)]
    return KindError(name, unit, mean[0], mean[1], int(np.isfinite(before).sum()))


def _reduction_interval(
    before: np.ndarray, after: np.ndarray, episodes: np.ndarray, rng: np.random.Generator
) -> tuple[float, float]:
    """Share of the error that is gone, 95 %, by a bootstrap over episodes."""
    known = np.isfinite(before) & np.isfinite(after)
    start, end = (by_episode(np.abs(values[known]), episodes[known]) for values in (before, after))
    if not len(start) or start.sum() == 0.0:
        return 0.0, 0.0
    draws = rng.multinomial(len(start), np.full(len(start), 1.0 / len(start)), size=_DRAWS)
    low, high = np.quantile(1.0 - draws @ end / np.maximum(draws @ start, 1e-300), [0.025, 0.975])
    return float(low), float(high)


@dataclass(frozen=True)
class _Drawn:
    floor_m: float
    horizon: Mapping[str, Any]
    worst_window: Mapping[str, Any]


def _paths(
    evidence: TossEvidence,
    rows: Sequence[int],
    nominal: Mapping[str, float],
    final: Mapping[str, float],
    rng: np.random.Generator,
) -> _Drawn:
    """Errors over time, and the noise floor: how far a replay goes astray because its start is known no better than it is."""
    tosses = [evidence.tosses[row] for row in rows if evidence.tosses[row].moves]
    before, after = (replayed(evidence.replayer, tosses, values) for values in (nominal, final))
    shaken = replayed(evidence.replayer, tosses, final, rng)
    distances = [
        [np.linalg.norm(path[0] - toss.position_m, axis=1) for path, toss in zip(paths, tosses, strict=True)]
        for paths in (before, after)
    ]
    astray = [np.linalg.norm(one[0] - other[0], axis=1) for one, other in zip(after, shaken, strict=True)]
    floor_m = float(np.mean([distance.mean() for distance in astray]))
    times_s = np.linspace(0.0, float(np.median([toss.time_s[-1] for toss in tosses])), _HORIZONS + 1)[1:]
    horizon = {"unit": "mm", "horizon_s": times_s.tolist(), "windows": len(tosses)} | {
        label: [_at_horizon(tosses, values, time_s) for time_s in times_s]
        for label, values in (("before", distances[0]), ("after", distances[1]), ("noise_floor", astray))
    }
    worst = int(np.argmax([distance.mean() for distance in distances[0]]))
    return _Drawn(floor_m, horizon, _window(tosses[worst], before[worst][0], after[worst][0]))


def _at_horizon(tosses: Sequence[Toss], distances: Sequence[np.ndarray], time_s: float) -> float:
    """Mean distance in mm at a time, of the tosses that last so long."""
    values = [np.interp(time_s, toss.time_s, d) for toss, d in zip(tosses, distances, strict=True) if toss.time_s[-1] >= time_s]
    return 1e3 * float(np.mean(values))


def _window(toss: Toss, before_m: np.ndarray, after_m: np.ndarray) -> dict[str, Any]:
    """The coordinate in which measured and replayed path are farthest apart."""
    axis = int(np.argmax(np.abs(before_m - toss.position_m).max(0)))
    paths = {"measured": toss.position_m, "before": before_m, "after": after_m}
    series = {label: (1e3 * path[:, axis]).tolist() for label, path in paths.items()}
    return {"where": f"{toss.name}, {'xyz'[axis]} of the object", "unit": "mm", "time_s": toss.time_s.tolist()} | series
