"""What a model that was fitted in rollouts says of others: what each cause would gain beside it, show or foretell.

All of it follows from how errors of windows change at the model, without another fit but for what is foretold.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.knowledge.unnamed_laws import BEARING
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import Hypothesis
from sim_backend.reality_gap.subjects.joints.laws.state import Term
from sim_backend.reality_gap.subjects.joints.rollouts.bounded_steps import apart, room_of, step_within
from sim_backend.reality_gap.subjects.joints.rollouts.linearisation import linearised
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit, RolloutProblem, is_simulated

SHOWN = 0.7
"""Of what a cause's number may be: windows that leave it more uncertain say nothing of it."""


@dataclass(frozen=True)
class Shown:
    """How well windows tell an effect: the size of its number that would have been seen at each place where it was asked for.

    Attributes:
        hypothesis: effect and place, with its terms.
        size: that gains what a cause must gain, in the unit of its first number; infinite where no window shows it.
    """

    hypothesis: Hypothesis
    size: float


def gains(
    problem: RolloutProblem, fit: RolloutFit, hypotheses: Sequence[Hypothesis], *, is_held: bool = True
) -> list[tuple[float, Hypothesis, np.ndarray, np.ndarray]]:
    """What hypotheses would gain beside a model, nats, with values and standard errors of their terms, the best first.

    Args:
        problem: windows.
        fit: the model.
        hypotheses: what may be wrong beside it.
        is_held: whether numbers of the model that are at the ends of their tolerances stay there; if not errors hold whatever
            these numbers are.
    """
    usable = [h for h in hypotheses if all(is_simulated(problem.catalogue.terms[i].key) for i in h.terms)]
    own = sorted({i for h in usable for i in h.terms})
    beside = problem.beside(fit.state, fit.terms)
    base = [*fit.terms, *(t for t, _ in beside)]
    scales = np.array([*fit.scales, *(scale for _, scale in beside)])
    every = [*base, *(problem.catalogue.terms[i] for i in own)]
    noise, weights = problem.noise_of(fit.squares)
    linear = linearised(problem.forward, problem.windows, fit.state, every, fit.begin, noise, weights)
    b = len(base)
    inner = linear.precision[:b, :b] + np.diag(1.0 / scales**2)
    own_pull = linear.pull[:b] - apart(fit.state, problem.start, base) / scales**2
    # what would go further than it may, and a rigid bearing that would go below none, makes up for nothing more
    least, most = room_of(fit.state, problem.start, base, scales, fit.causes)
    step = step_within(inner, own_pull, least, most)
    moves = (step > least) & (step < most) | np.array([not is_held and term.key not in BEARING for term in base], bool)
    across = linear.precision[:b, b:][moves]
    precision = linear.precision[b:, b:] - across.T @ np.linalg.solve(inner[np.ix_(moves, moves)], across)
    pull = linear.pull[b:] - linear.precision[b:, :b] @ step
    found = []
    for h in usable:
        index = [own.index(i) for i in h.terms]
        scale = np.array(h.scales)
        a = np.eye(len(index)) + scale[:, None] * precision[np.ix_(index, index)] * scale
        values = scale * np.linalg.solve(a, scale * pull[index])
        gain = float(0.5 * pull[index] @ values - 0.5 * np.linalg.slogdet(a)[1])
        found.append((gain, h, values, scale * np.sqrt(np.maximum(np.diag(np.linalg.inv(a)), 0.0))))
    return sorted(found, key=lambda entry: -entry[0])


def shown(problem: RolloutProblem, fit: RolloutFit, hypotheses: Sequence[Hypothesis], gate: float) -> list[Shown]:
    """For each hypothesis the size that would have gained ``gate`` nats beside a model."""
    found = []
    for _, hypothesis, values, errors in gains(problem, fit, hypotheses, is_held=False):
        prior = np.array(hypothesis.scales)
        is_shown, term = errors[0] < SHOWN * prior[0], problem.catalogue.terms[hypothesis.terms[0]]
        off = float(values[0] + apart(fit.state, problem.start, [term])[0])
        size = float(np.sqrt(2.0 * gate) * errors[0]) + abs(off) if is_shown else np.inf
        found.append(Shown(hypothesis, size))
    return found


def would_move_nats(problem: RolloutProblem, fit: RolloutFit) -> float:
    """What a model's causes would gain if they moved on as its linearisation says, nats; nothing where they have settled.

    A model of another shape than the robot's may be stuck where no step brings it nearer, far from where each step points.
    """
    terms, scales = fit.terms[: fit.causes], fit.scales[: fit.causes]
    linear = linearised(problem.forward, problem.windows, fit.state, terms, fit.begin, *problem.noise_of(fit.squares))
    pull = linear.pull - apart(fit.state, problem.start, terms) / scales**2
    return float(0.5 * pull @ np.linalg.solve(linear.precision + np.diag(scales**-2.0), pull)) if terms else 0.0


def foretold(problem: RolloutProblem, fit: RolloutFit, terms: Sequence[Term]) -> np.ndarray:
    """Mean square errors of windows, shape (n, k), with terms fitted to other recordings: of other regimes, if there are any.

    Where there is one recording only they are those of the fit.
    """
    fold, squares = problem.folds, fit.squares.copy()
    for each in np.unique(fold) if len(np.unique(fold)) > 1 else ():
        seen, unseen = np.flatnonzero(fold != each), np.flatnonzero(fold == each)
        own, other = (tuple(b[rows] for b in fit.begin) for rows in (seen, unseen))
        learned = problem.part(seen).fitted(fit.state, terms, own, quickly=True)  # pyrefly: ignore[bad-argument-type]
        squares[unseen] = problem.part(unseen).fitted(learned.state, (), other, quickly=True).squares  # pyrefly: ignore[bad-argument-type]
    return squares


def foretold_rad(problem: RolloutProblem, fit: RolloutFit, terms: Sequence[Term]) -> float:
    """How far windows end up off, in the mean over all of them and joints, whose recordings the terms were not fitted to."""
    return float(np.sqrt(foretold(problem, fit, terms)).mean())
