"""How probable residuals are, what a hypothesis gains on tosses that it was not fitted to, and how sure that is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.subjects.tosses.evidence import EvidenceKind

_NU = 4.0  # degrees of freedom of Student's t: tosses that go another way at an edge must not decide
_ITERATIONS = 25
TOSS_FOLDS = 5

Residuals = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Point:
    """Values of a hypothesis and the residuals of all tosses under study at them."""

    values: Mapping[str, float]
    residuals: Residuals


@dataclass(frozen=True)
class Weights:
    """How much the log density of one toss counts in each kind of evidence."""

    of: Mapping[str, float]


def weights(kinds: Sequence[EvidenceKind], residuals: Residuals) -> Weights:
    """From the number of tosses with each kind of evidence, their scatter and their common error."""
    out = {}
    for kind in kinds:
        count = int(np.isfinite(residuals[kind.name]).sum())
        out[kind.name] = kind.scale**2 / (count * kind.systematic**2 + kind.scatter**2) if kind.systematic else 1.0
    return Weights(out)


def scale_of(residual: np.ndarray, dimensions: int) -> float:
    """Scale of Student's t around zero that makes residuals most probable, by expectation and maximisation."""
    square = residual[np.isfinite(residual)] ** 2
    if not len(square):
        return 1.0
    variance = max(float(np.median(square)), 1e-18)
    for _ in range(_ITERATIONS):
        weight = (_NU + dimensions) / (_NU + square / variance)
        variance = max(float((weight * square).mean() / dimensions), 1e-18)
    return float(np.sqrt(variance))


def log_density(residual: np.ndarray, scale: float, dimensions: int) -> np.ndarray:
    """Of each residual, up to a constant, nats; 0 where there is none."""
    density = -dimensions * np.log(scale) - 0.5 * (_NU + dimensions) * np.log1p((residual / scale) ** 2 / _NU)
    return np.where(np.isfinite(residual), density, 0.0)


def densities(kinds: Sequence[EvidenceKind], weight: Weights, point: Residuals, train: np.ndarray) -> dict[str, np.ndarray]:
    """Weighted log density of each toss by kind.

    The scale of a kind with a systematic error is known beforehand; that of the others comes from the tosses ``train`` (a mask,
    shape (n,)), for nobody knows how far a replay goes astray.
    """
    out = {}
    for kind in kinds:
        residual = point[kind.name]
        scale = kind.scale if kind.systematic else scale_of(residual[train], kind.dimensions)
        out[kind.name] = weight.of[kind.name] * log_density(residual, scale, kind.dimensions)
    return out


def total(kinds: Sequence[EvidenceKind], weight: Weights, point: Residuals) -> float:
    """Log density of all tosses, with scales from the same ones: what a search maximises."""
    everything = np.ones(len(next(iter(point.values()))), bool)
    return float(sum(values.sum() for values in densities(kinds, weight, point, everything).values()))


def held_out_gains(
    kinds: Sequence[EvidenceKind], weight: Weights, base: Point, points: Sequence[Point], folds: np.ndarray
) -> dict[str, np.ndarray]:
    """What each toss gains by kind when the hypothesis is fitted to the other folds, shape (n,), nats.

    The fit chooses among ``points`` (and ``base``); scales, too, come from the other folds.
    """
    n = len(folds)
    out = {kind.name: np.zeros(n) for kind in kinds}
    for fold in np.unique(folds):
        train, test = folds != fold, folds == fold
        before = densities(kinds, weight, base.residuals, train)
        after = max(
            (densities(kinds, weight, point.residuals, train) for point in (base, *points)),
            key=lambda density, train=train: sum(values[train].sum() for values in density.values()),
        )
        for name, gain in out.items():
            gain[test] = (after[name] - before[name])[test]
    return out


def folds_of(episodes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A fold for each toss, so that tosses of one episode stay together; as many folds as episodes if these are few."""
    unique = np.unique(episodes)
    number = dict(zip(rng.permutation(unique).tolist(), range(len(unique)), strict=True))
    return np.array([number[episode] % min(TOSS_FOLDS, len(unique)) for episode in episodes.tolist()])


def by_episode(gain: np.ndarray, episodes: np.ndarray) -> np.ndarray:
    """Sums over the tosses of each episode."""
    _, place = np.unique(episodes, return_inverse=True)
    return np.bincount(place, weights=gain)


def bootstrap_sums(sums: np.ndarray, rng: np.random.Generator, draws: int = 1000) -> np.ndarray:
    """Totals over episodes drawn with replacement, shape (draws,)."""
    return rng.multinomial(len(sums), np.full(len(sums), 1.0 / len(sums)), size=draws) @ sums


def sign_flip_p(sums: Sequence[np.ndarray], rng: np.random.Generator, draws: int = 2000) -> float:
    """How often the largest standardised gain of all hypotheses is as large as measured if the signs of episodes are chance.

    Args:
        sums: gain of each episode for each hypothesis, each of shape (episodes,).
        rng: source of the signs, the same for all hypotheses.
        draws: number of sign patterns.
    """
    gains = np.array(sums)
    size = np.sqrt((gains**2).sum(1))
    use = size > 0.0
    if not use.any():
        return 1.0
    gains = gains[use] / size[use, None]
    flips = rng.choice([-1.0, 1.0], size=(draws, gains.shape[1]))
    largest = (flips @ gains.T).max(1)
    return float((1 + np.sum(largest >= gains.sum(1).max())) / (1 + draws))
