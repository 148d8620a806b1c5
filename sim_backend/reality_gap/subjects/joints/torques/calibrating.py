"""Plain calibration, to compare the naming tool with: all numbers at once, by coordinate descent or by SimOpt.

Both work on the same linearised equations as the naming tool. Neither names a cause: they say which numbers they would change.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize, special

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import plane_of
from sim_backend.reality_gap.quantiles import Z_90
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import PLATFORM
from sim_backend.reality_gap.subjects.joints.laws.moves import moved
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.torques.look import JointProblem, Look
from sim_backend.reality_gap.verdict import Cause

METHODS = ("naming", "rollouts", "torques", "simopt", "coordinate-descent")
"""How joints are studied: torques propose and rollouts decide, either alone, and two that only calibrate."""
LEAST_GAIN = 0.001
"""Share of the error that a change must take away (Dactyl, arXiv 1808.00177)."""
_SWEEPS = 30
KL_BOUND_NATS = 1.0
"""Largest divergence of one update of the distribution (the idea of SimOpt, arXiv 1810.05687; its number for our scales)."""
_ITERATIONS, _SAMPLES = 200, 600
_LEAST_SPREAD = 1e-4
_REPORTED = 0.05  # of a number's scale


@dataclass(frozen=True)
class Calibrated:
    """A model, and the numbers that were changed to get it, with intervals."""

    state: JointState
    causes: tuple[Cause, ...]


def calibrate(problem: JointProblem, start: JointState, method: str, rng: np.random.Generator) -> Calibrated:
    """Calibrate all numbers.

    Args:
        problem: the episodes.
        start: the nominal model.
        method: ``simopt`` or ``coordinate-descent``.
        rng: draws SimOpt's samples.
    """
    look = problem.look(start, ())
    index = _numbers(look)
    terms = [look.catalogue.terms[i] for i in index]
    scales = np.array([look.catalogue.scales[term.key] for term in terms])
    images, cross, square = look.sums.weighted(np.ones(look.sums.folds))
    quadratic = scales[:, None] * images[np.ix_(index, index)] * scales
    linear = scales * cross[index]
    lower, upper = _bounds(terms, start, scales)
    if method == "coordinate-descent":
        mean = _coordinate_descent(quadratic, linear, square, lower, upper)
        spread = 1.0 / np.sqrt(np.maximum(np.diag(quadratic), 1e-12))
    else:
        mean, spread = _simopt(quadratic, linear, lower, upper, rng)
    state = start
    for term, value in zip(terms, mean * scales, strict=True):
        state = moved(state, [term], np.array([value])) if abs(value) > 0.0 else state
    return Calibrated(state, tuple(_causes(problem, start, terms, mean, spread, scales)))


def _numbers(look: Look) -> list[int]:
    """One term for each number: the first shape of each single place; springs and cogging need two and are left out."""
    found: dict[tuple[str, int], int] = {}
    for h in look.catalogue.hypotheses:
        if (len(h.terms) > 1 and h.where != PLATFORM) or plane_of(h.effect) is not None:
            continue
        for i in h.terms:
            term = look.catalogue.terms[i]
            found.setdefault((term.key, term.index), i)
    return list(found.values())


def _bounds(terms: Sequence[Term], start: JointState, scales: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    here = np.array([start.value(t.key)[t.index] for t in terms])
    lower = np.array([start.bounds(t.key)[0] for t in terms]) - here
    upper = np.array([max(start.bounds(t.key)[1], h) for t, h in zip(terms, here, strict=True)]) - here
    return lower / scales, upper / scales


def _coordinate_descent(
    quadratic: np.ndarray, linear: np.ndarray, square: float, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """One number after the other to its best value, as long as that takes away a share of the error; shape (m,)."""
    value, left = np.zeros(len(linear)), square
    for _ in range(_SWEEPS):
        before = left
        for i in range(len(value)):
            slope, curve = linear[i] - quadratic[i] @ value, quadratic[i, i]
            if curve <= 0.0:
                continue
            step = np.clip(value[i] + slope / curve, lower[i], upper[i]) - value[i]
            gained = 2.0 * slope * step - curve * step**2
            if gained > LEAST_GAIN * left:
                value[i] += step
                left -= gained
        if before - left <= LEAST_GAIN * before:
            break
    return value


def _simopt(
    quadratic: np.ndarray, linear: np.ndarray, lower: np.ndarray, upper: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A Gaussian over the numbers, moved towards what fits within a bound on each update; mean and spread, shape (m,)."""
    mean, covariance = np.zeros(len(linear)), np.diag(np.full(len(linear), 0.25))
    for _ in range(_ITERATIONS):
        drawn = np.clip(mean + rng.standard_normal((_SAMPLES, len(mean))) @ linalg.cholesky(covariance), lower, upper)
        weight = _bounded_weights(0.5 * ((drawn @ quadratic) * drawn).sum(axis=1) - drawn @ linear)
        mean = weight @ drawn
        covariance = (weight[:, None] * (drawn - mean)).T @ (drawn - mean) + _LEAST_SPREAD**2 * np.eye(len(mean))
    return mean, np.sqrt(np.diag(covariance))


def _bounded_weights(cost: np.ndarray) -> np.ndarray:
    """Weights of samples that are as greedy as the bound on the divergence allows, shape (s,)."""

    def divergence(log_temperature: float) -> float:
        log_weight = special.log_softmax(-cost / np.exp(log_temperature))
        return float(np.exp(log_weight) @ (log_weight + np.log(len(cost)))) - KL_BOUND_NATS

    low, high = np.log(np.ptp(cost) * 1e-9 + 1e-12), np.log(np.ptp(cost) * 1e3 + 1e-9)
    if divergence(low) <= 0.0:
        return special.softmax(-cost / np.exp(low))
    root: float = optimize.brentq(divergence, low, high)  # pyrefly: ignore[bad-assignment] - without full_output a number
    return special.softmax(-cost / np.exp(root))


def _causes(
    problem: JointProblem, start: JointState, terms: Sequence[Term], mean: np.ndarray, spread: np.ndarray, scales: np.ndarray
) -> list[Cause]:
    found = []
    for term, value, error, scale in sorted(zip(terms, mean, spread, scales, strict=True), key=lambda row: -abs(row[1])):
        if abs(value) < _REPORTED:
            continue
        parameter = PARAMETERS[term.key]
        where = problem.names[term.index] if parameter.width == 9 else "xyz"[term.index] if parameter.width == 3 else "platform"
        here = start.value(term.key)[term.index]
        middle, half = float(here + value * scale), float(Z_90 * error * scale)
        found.append(Cause(term.effect, parameter.name, where, middle, parameter.unit, (middle - half, middle + half)))
    return found
