"""How late commands came, read off one by one: until a command has come, the pipeline works with the one before it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import optimize, stats

from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.torques.fit import JointFit
from sim_backend.reality_gap.subjects.joints.torques.sent_torque import LATENESS

_LEAST_COMMANDS = 20


def with_measured_lateness(fit: JointFit, episodes: Sequence[EpisodeEquations]) -> JointFit:
    """The fit with the scale of lateness as counted, where late commands are among its causes; else the same fit."""
    taken = next((a for a in fit.accepted if a.effect == LATENESS.partition(".")[0]), None)
    late = np.concatenate([episode.late_steps(fit.state) for episode in episodes])
    if taken is None or len(late) < _LEAST_COMMANDS:
        return fit
    std_s, error_s = lateness_std_s(late, episodes[0].path.step_s)
    state = replace(fit.state, given={**fit.state.given, LATENESS: np.array([std_s])})
    errors = {**fit.errors, (taken.effect, taken.where): np.full(len(taken.terms), error_s)}
    return replace(fit, state=state, errors=errors)


def lateness_std_s(late_steps: np.ndarray, step_s: float) -> tuple[float, float]:
    """Scale of half-normal lateness and its standard error, from how many whole steps each command came late.

    A position target acts in a step if it came before half of it was over: counts are rounded, which the scale allows for.

    Args:
        late_steps: shape (n,).
        step_s: of the samples.
    """
    mean, error = float(np.mean(late_steps)), float(np.std(late_steps) / np.sqrt(len(late_steps)))
    largest = 4.0 * float(np.max(late_steps)) + 4.0

    def excess(std_steps: float) -> float:
        return _mean_of_rounded(std_steps) - mean

    if mean <= 0.0:
        return 0.0, step_s
    std_steps: float = optimize.brentq(excess, 1e-2, largest)  # pyrefly: ignore[bad-assignment] - a number
    slope = (_mean_of_rounded(1.01 * std_steps) - _mean_of_rounded(0.99 * std_steps)) / (0.02 * std_steps)
    return std_steps * step_s, error / slope * step_s


def _mean_of_rounded(std_steps: float) -> float:
    """Expected rounded lateness for a half-normal one, in steps."""
    halves = np.arange(0.5, 6.0 * std_steps + 1.5)
    return float(2.0 * stats.norm.sf(halves / std_steps).sum())
