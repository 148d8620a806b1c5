"""How late commands came, read off one by one: until a command has come, the pipeline works with the one before it."""

from dataclasses import replace

import numpy as np
from scipy import optimize, special, stats

from sim_backend.reality_gap.knowledge.healthy import detection_limits
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import PLATFORM
from sim_backend.reality_gap.subjects.joints.torques.fit import JointFit
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted, JointProblem
from sim_backend.reality_gap.subjects.joints.torques.sent_torque import LATENESS

_LEAST_COMMANDS = 20
_USUAL_SHARE = 1e-3
"""Of a TriFinger's commands at most, of which a healthy one has none, that come late without a cause."""

_MOST_LEFT = 0.1
"""Of what was sent beyond what the pipeline makes: where more is left, something else looks like lateness."""


def with_measured_lateness(problem: JointProblem, fit: JointFit) -> JointFit:
    """The fit with the scale of lateness as counted, where late commands are among its causes; else the same fit.

    They are a cause as well where a TriFinger differs everywhere, of which the fit sees none, if they are as late as can be told
    from commands that came in time, by turns, and that explains what was sent.
    """
    effect = LATENESS.partition(".")[0]
    taken = next((a for a in fit.accepted if a.effect == effect), None)
    found = [episode.late_commands(fit.state) for episode in problem.episodes]
    late = np.concatenate([each.steps for each in found])
    if len(late) < _LEAST_COMMANDS or effect in problem.excluded:
        return fit
    std_s, error_s = lateness_std_s(late, problem.episodes[0].path.step_s)
    if taken is None:
        left = sum(each.left for each in found) / max(sum(each.beside for each in found), 1e-12)
        is_lateness = std_s >= detection_limits()[LATENESS] and left <= _MOST_LEFT and _is_by_turns(late)
        if not fit.problem.is_of_many or not is_lateness:
            return fit
        term = next(term for term in fit.last.catalogue.terms if term.key == LATENESS)
        taken = Accepted(effect, PLATFORM, (term,), _gain(late))
        fit = replace(fit, accepted=(*fit.accepted, taken))
    state = replace(fit.state, given={**fit.state.given, LATENESS: np.array([std_s])})
    errors = {**fit.errors, (taken.effect, taken.where): np.full(len(taken.terms), error_s)}
    return replace(fit, state=state, errors=errors)


def _is_by_turns(late_steps: np.ndarray) -> bool:
    """Whether about as many commands came in time as of half-normal lateness: where all are late, the log is shifted."""
    std_steps = lateness_std_s(late_steps, 1.0)[0]
    in_time = float(1.0 - 2.0 * stats.norm.sf(0.5 / std_steps)) if std_steps > 0.0 else 1.0
    return bool(np.mean(late_steps == 0) > 0.5 * in_time)


def _gain(late_steps: np.ndarray) -> float:
    """Of late commands over the usual share of them, nats."""
    share = np.clip(np.mean(late_steps > 0), _USUAL_SHARE, 1.0 - _USUAL_SHARE)
    return float(len(late_steps) * (special.rel_entr(share, _USUAL_SHARE) + special.rel_entr(1.0 - share, 1.0 - _USUAL_SHARE)))


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
