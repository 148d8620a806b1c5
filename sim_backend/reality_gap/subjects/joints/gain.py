"""What the named causes bought: torque errors on stretches or episodes that the parameters were not fitted to."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import Channel
from sim_backend.reality_gap.subjects.joints.laws.moves import deviations, moved
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.signs.rattling import HitErrors
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.torques.look import JointProblem, Look
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import FOLDS, folds_of
from sim_backend.reality_gap.verdict import HeldOut

_RESAMPLES = 2000


@dataclass(frozen=True)
class TorqueErrors:
    """Root mean square torque error by joint, shape (k,), N m, and of all joints over each joint's own noise floor.

    ``squares`` has shape (blocks, k): sums of squares of each fold of each episode, and ``rows`` alike how many rows they are of.
    """

    squares: np.ndarray
    rows: np.ndarray

    @property
    def by_joint_nm(self) -> np.ndarray:
        """Of each joint, shape (k,)."""
        return np.sqrt(self.squares.sum(axis=0) / np.maximum(self.rows.sum(axis=0), 1.0))

    @property
    def all_joints_nm(self) -> float:
        """Over all rows of all joints."""
        return float(np.sqrt(self.squares.sum() / max(self.rows.sum(), 1.0)))


def held_out_errors(problem: JointProblem, look: Look) -> TorqueErrors:
    """Errors of the causes of a look, on each fold with parameters that were fitted to the other folds.

    Where these say nothing of a parameter it stays as the model has it that the problem's selection started from.
    """
    states = [_state_without(look, problem.start, fold) for fold in range(FOLDS)]
    return _errors(problem, states)


def errors_of(problem: JointProblem, state: JointState) -> TorqueErrors:
    """Errors of one model."""
    return _errors(problem, [state] * FOLDS)


def _errors(problem: JointProblem, states: Sequence[JointState]) -> TorqueErrors:
    squares, rows = [], []
    for episode in problem.episodes:
        fold = folds_of_rows(episode, len(problem.episodes))
        for f in np.unique(fold):
            left = np.where(episode.valid_mechanics, episode.torque_error(states[f]), 0.0)[fold == f]
            squares.append((left**2).sum(axis=0))
            rows.append(episode.valid_mechanics[fold == f].sum(axis=0))
    return TorqueErrors(np.array(squares), np.array(rows, dtype=float))


def folds_of_rows(episode: EpisodeEquations, episodes: int) -> np.ndarray:
    """Fold of each row of an episode, shape (t,)."""
    equation = episode.empty_equation(Channel.MECHANICS)
    return folds_of(equation, episodes)


def _state_without(look: Look, start: JointState, fold: int) -> JointState:
    """The look's model with its causes' parameters fitted anew without one fold, their priors about the nominal values."""
    own = [term for a in look.accepted for term in a.terms]
    if not own:
        return look.state
    first = len(look.catalogue.terms)
    index = np.arange(first, first + len(own))
    images, cross, _ = look.sums.weighted(1.0 - np.eye(FOLDS)[fold])
    base = np.flatnonzero(np.diag(images)[:first] * look.tolerance[:first] > 0.0)
    both = np.concatenate([base, index])
    precision = images[np.ix_(both, both)] + np.diag(1.0 / np.maximum(look.tolerance[both], 1e-12) ** 2)
    away = np.zeros(len(both))
    away[len(base) :] = np.concatenate([deviations(look.state, start, a.terms) for a in look.accepted])
    pulled = cross[both] - away / np.maximum(look.tolerance[both], 1e-12) ** 2
    change = np.linalg.solve(precision, pulled)[len(base) :]
    return _moved(look, change)


def _moved(look: Look, change: np.ndarray) -> JointState:
    state, at = look.state, 0
    for a in look.accepted:
        terms: tuple[Term, ...] = a.terms
        state = moved(state, terms, change[at : at + len(terms)])
        at += len(terms)
    return state


def held_out(
    problem: JointProblem, look: Look, start: JointState, rng: np.random.Generator, *, when: str = "while they move"
) -> HeldOut:
    """Errors before and after with the reduction's interval from a bootstrap over folds of episodes; ``when`` rows count."""
    before, after = errors_of(problem, start), held_out_errors(problem, look)
    between = _between(before.squares.sum(axis=1), after.squares.sum(axis=1), rng)
    rows = np.concatenate([e.valid_mechanics for e in problem.episodes]).sum(axis=0)
    floors = np.mean([e.torque_error_floor_nm for e in problem.episodes], axis=0)
    cutoff = problem.episodes[0].path.cutoff_hz
    return HeldOut(
        metric=f"torque error (root mean square over all joints {when}, below {cutoff:g} Hz)",
        unit="N m",
        before=before.all_joints_nm,
        after=after.all_joints_nm,
        noise_floor=float(np.sqrt((floors**2) @ rows / max(rows.sum(), 1))),
        reduction=1.0 - after.all_joints_nm / max(before.all_joints_nm, 1e-30),
        reduction_interval_95=between,
        samples=int(rows.sum()),
    )


def held_out_of_hits(errors: HitErrors, joint: str, rng: np.random.Generator) -> HeldOut:
    """Errors before and after in the windows in which a joint's rotor hits, with the reduction's interval alike."""
    windows = max(float(errors.windows.sum()), 1.0)
    before, after = (float(np.sqrt(squares.sum() / windows)) for squares in (errors.before, errors.after))
    return HeldOut(
        metric=f"how far the torques put {joint} off within {1e3 * errors.window_s:.0f} ms, where its rotor hits",
        unit="rad",
        before=before,
        after=after,
        noise_floor=errors.noise_rad,
        reduction=1.0 - after / max(before, 1e-30),
        reduction_interval_95=_between(errors.before, errors.after, rng),
        samples=int(windows),
    )


def _between(before: np.ndarray, after: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """95 % interval of a reduction by a bootstrap over blocks, whose sums of squares have shape (b,)."""
    counted = before > 0.0  # a block without rows says nothing
    before, after = before[counted], after[counted]
    if not len(before):
        return 0.0, 0.0
    weights = rng.multinomial(len(before), np.full(len(before), 1.0 / len(before)), _RESAMPLES)
    ratios = np.sqrt((weights @ after) / np.maximum(weights @ before, 1e-30))
    low, high = np.quantile(1.0 - ratios, [0.025, 0.975])
    return float(low), float(high)
