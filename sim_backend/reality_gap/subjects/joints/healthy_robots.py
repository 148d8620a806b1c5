"""How far robots end up from their model that nothing is wrong with: drawn within the tolerances, in a study's own windows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.reality_gap.subjects.joints.forward import Windows
from sim_backend.reality_gap.subjects.joints.linearisation import SAMPLES_OF_WINDOW, probed
from sim_backend.reality_gap.subjects.joints.recorded_windows import LEAST_WINDOWS
from sim_backend.reality_gap.subjects.joints.rollout_fit import (
    FAR_SHARE,
    TOLERATED,
    RolloutProblem,
    moved_by,
)
from sim_backend.reality_gap.subjects.joints.state import CLOCK, JointState, Term

_AT_ONCE = 20
"""Healthy robots that are simulated together."""
_USUAL = 0.95
"""Share of robots that nothing is wrong with that are off by no more."""


@dataclass(frozen=True)
class Healthy:
    """What windows of healthy robots end up off, of all but 5 % of the robots no more at any joint; shapes (k,), rad.

    Attributes:
        as_it_is_rad: usual windows from the model as it was given.
        fitted_rad: from a model that was fitted within the tolerances: what bends with a tolerated error, and noise.
        fitted_far_rad: what nine windows of ten stay below there.
    """

    as_it_is_rad: np.ndarray
    fitted_rad: np.ndarray
    fitted_far_rad: np.ndarray


def draw_healthy(problem: RolloutProblem, rng: np.random.Generator, draws: int = 200) -> Healthy:
    """Draw robots within the tolerances and simulate them in windows of a study, with the noise of its encoders and torques.

    Of each, as of the recorded one, windows begin where they fit best, and the median of their errors and the ninth of ten count.

    Args:
        problem: whose windows.
        rng: draws.
        draws: robots.
    """
    rows = np.linspace(0, len(problem.windows) - 1, min(LEAST_WINDOWS, len(problem.windows))).astype(int)
    windows = problem.windows.some(rows)
    loose = problem.loose_terms(())
    terms, scales = [term for term, _ in loose], np.array([scale for _, scale in loose])
    nominal, at_start, by_term = _images(problem, windows, terms)
    fine = np.isfinite(at_start).all(axis=(1, 2)) & np.isfinite(by_term).all(axis=(1, 2))
    if not fine.any():
        return Healthy(problem.noise_rad, problem.noise_rad, problem.noise_rad)
    is_clock = np.array([term.key == CLOCK for term in terms])
    off = scales * ~is_clock * np.clip(rng.standard_normal((draws, len(loose))), -TOLERATED, TOLERATED)
    drawn = [moved_by(problem.start, terms, change) for change in off]
    error = np.concatenate([_apart(problem, windows, drawn[i : i + _AT_ONCE], nominal, rng) for i in range(0, draws, _AT_ONCE)])
    error = error[:, fine]
    error = np.nan_to_num(error, nan=np.nanmax(np.abs(error), initial=0.0)).transpose(1, 2, 0)  # what diverges is as far as any
    noise = np.tile(problem.noise_rad, error.shape[1] // len(problem.noise_rad))[:, None]
    error = error + noise * rng.standard_normal(error.shape)
    weights = np.sqrt(SAMPLES_OF_WINDOW / windows.position_rad.shape[1]) / noise
    error, at_start, by_term = weights * error, weights * at_start[fine], weights * by_term[fine]
    begun = np.linalg.pinv(at_start)
    as_it_is = error - at_start @ (begun @ error)
    free = by_term - at_start @ (begun @ by_term)
    every = free.reshape(-1, len(scales))
    precision = every.T @ every + np.diag(1.0 / scales**2)
    fitted = as_it_is - free @ np.linalg.solve(precision, every.T @ as_it_is.reshape(len(every), -1))
    shares = ((as_it_is, 0.5), (fitted, 0.5), (fitted, FAR_SHARE))
    return Healthy(*(_below(left / weights, len(problem.noise_rad), share) for left, share in shares))


def _below(left_rad: np.ndarray, joints: int, share: float) -> np.ndarray:
    """Of errors (n, s * k, draws) what a share of the windows of nearly all robots stays below at every joint, shape (k,).

    Of many joints one is further off than its own usual more often than each of them: all limits are raised alike.
    """
    squares = (left_rad.reshape(len(left_rad), -1, joints, left_rad.shape[2]) ** 2).mean(axis=1)
    off_rad = np.sqrt(np.quantile(squares, share, axis=0))
    usual_rad = np.quantile(off_rad, _USUAL, axis=1)
    return usual_rad * max(1.0, float(np.quantile((off_rad.T / usual_rad).max(axis=1), _USUAL)))


def _images(problem: RolloutProblem, windows: Windows, terms: Sequence[Term]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the nominal model goes, (n, s * k), and what its start, (n, s * k, 2 k), and terms, (n, s * k, m), change in that."""
    n, m = len(windows), len(terms)
    went, moves = probed(problem.forward, windows, problem.start, terms, (windows.begin_rad, windows.begin_rad_s))
    moves = moves.reshape(len(moves), n, -1).transpose(1, 2, 0)
    return went.reshape(n, -1), moves[:, :, m:], moves[:, :, :m]


def _apart(
    problem: RolloutProblem, windows: Windows, states: Sequence[JointState], from_rad: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """How far models go from where another one goes, shape (models, n, s * k), rad.

    They are driven by torques that were measured with noise, or by a controller that sees noisy positions and velocities.
    """
    n = len(windows)
    many = windows.some(np.tile(np.arange(n), len(states)))
    shape, law = many.sent_nm.shape, many.feedback
    felt = many.sent_nm + problem.torque_noise_nm * rng.standard_normal(shape)
    if law is not None:
        position = law.stiffness_nm_rad * problem.noise_rad * rng.standard_normal(shape)
        velocity = law.damping_nm_s_rad * problem.velocity_noise_rad_s * rng.standard_normal(shape)
        law = replace(law, desired_nm=law.desired_nm - position - velocity)
    which = np.repeat(np.arange(len(states)), n)
    went = problem.forward.positions(replace(many, sent_nm=felt, feedback=law), many.begin_rad, many.begin_rad_s, states, which)
    return went.reshape(len(states), n, -1) - from_rad
