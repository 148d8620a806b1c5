"""Other causes that explain as well where a robot went."""

from dataclasses import replace

import numpy as np
from scipy import special

from sim_backend.reality_gap.knowledge.separation import separated_by
from sim_backend.reality_gap.subjects.joints.rollouts.recorded_windows import LEAST_WINDOWS
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit, RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import Taken
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection, instead, without
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_trials import OF_NUMBER
from sim_backend.reality_gap.verdict import Rival

_SURE = 0.95
"""How sure it must be, by windows that are few, which of two models is nearer."""
CONFUSABLE_NATS, CONFUSABLE_SHARE = 5.0, 0.1
"""A rival that lies less than this behind, or than this share of what the cause gained, cannot be told apart."""
_RIVALS = 3
"""So many other effects at most are compared with a cause."""

Rivalling = tuple[Rival, Taken, RolloutFit]
"""What is told of another cause, that cause, and the model with it."""


def rivals_of(selection: RolloutSelection, taken: Taken) -> list[Rivalling]:
    """Other effects that come nearest to a cause, each with its model; the best of them at least, others if they came near.

    One that was taken later, too, stands against both: whether it would do without this one. Any other that was about as good by
    the time the cause was taken is tried once more in its place beside those that were taken later: what was best by then need
    not be.
    """
    own, later, found = taken.hypothesis, {cause.hypothesis.name for cause in selection.taken}, list[Rivalling]()
    for gain, fit, other, terms in taken.others:
        if other.effect in {own.effect, *(each[0].effect for each in found)}:
            continue
        rival, alone = Rival(other.effect, other.where, taken.gain - gain, _separated(other.effect, own.effect)), fit
        was_near = is_near(rival, taken)
        if found and not (was_near and len(found) < _RIVALS):
            break
        if other.name in later:
            alone = without(selection, taken)
            lost = selection.problem.gained(alone.squares, selection.fit.squares) - OF_NUMBER * len(taken.terms)
            rival = replace(rival, behind=lost)
            if not is_near(rival, taken):
                continue
        elif len(selection.taken) > 1 and (was_near or len(selection.problem.windows) < LEAST_WINDOWS):
            alone = instead(selection, taken, fit, terms)
            lost = selection.problem.gained(alone.squares, selection.fit.squares)
            rival = replace(rival, behind=lost - OF_NUMBER * (len(taken.terms) - len(terms)))
        found.append((rival, Taken(other, terms, gain, ()), alone))
    return found


def _separated(other: str, own: str) -> str:
    return separated_by(other, own, "slow and fast motion, little and much load")


def is_near(rival: Rival, taken: Taken) -> bool:
    """Whether two causes explain the same: one that follows so closely may only have been fitted a little worse."""
    return rival.behind < max(CONFUSABLE_NATS, CONFUSABLE_SHARE * taken.gain)


def is_ahead(problem: RolloutProblem, fit: RolloutFit, other: RolloutFit) -> bool:
    """Whether a model is surely nearer than another, by what their windows say of that where these are few.

    Nats are of errors that are noise. Real robots leave more than that, and a few windows may prefer one of two wrong laws by
    chance. Source: Q. H. Vuong, Econometrica 57 (1989) 307, with Student's law.
    """
    windows = len(problem.windows)
    if windows >= LEAST_WINDOWS:
        return True
    ahead = problem.gained_by_window(other.squares, fit.squares)
    error = float(ahead.std(ddof=1)) / np.sqrt(windows) if windows > 1 else np.inf
    return bool(ahead.mean() > special.stdtrit(windows - 1, _SURE) * error)
