"""Values of causes that something measured rules out, however well they fit."""

from collections.abc import Sequence

import numpy as np

from sim_backend.reality_gap.subjects.joints.laws import motor_law
from sim_backend.reality_gap.subjects.joints.laws.body_law import gravity_of
from sim_backend.reality_gap.subjects.joints.laws.motor_law import LIMIT
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted, JointProblem

_MOVES_RAD_S = 0.1
_OFTEN = 0.99
_MASSES_OFF = 0.1
"""Share by which what a motion needs may be too much, since the model's masses are not exact."""
_GRAVITY_OFF = 0.02
"""Share by which gravity may be stronger or weaker: the earth's differs by 0.5 %."""
_NOISE = 3.0
_AT_BOUND = 1e-6
"""Share of what the catalogue allows within which a value has run into its end."""


def torque_that_acted_nm(problem: JointProblem) -> np.ndarray:
    """What each joint's motor gave at least at some time, shape (k,), N m.

    While a joint moves the way in which its motion needs torque, friction only adds to what gravity and inertia ask for, so that
    the motor gives no less. The largest is taken that is no outlier, less what noise and inexact masses may make of it.
    """
    found = np.zeros(len(problem.names))
    for episode in problem.episodes:
        needed, velocity = episode.dynamics.torque_nm, episode.path.velocity
        works = episode.valid_mechanics & (np.abs(velocity) > _MOVES_RAD_S) & (needed * velocity > 0.0)
        for j, rows in enumerate(works.T):
            if rows.any():
                often = float(np.quantile(np.abs(needed[rows, j]), _OFTEN))
                least = (1.0 - _MASSES_OFF) * often - _NOISE * float(episode.torque_error_floor_nm[j])
                found[j] = max(found[j], least)
    return found


def contradicts(problem: JointProblem, state: JointState) -> bool:
    """Whether a model's motors could not have given what the recorded motion took."""
    if LIMIT not in state.given:
        return False
    limit, first = state.value(LIMIT), problem.start.value(LIMIT)
    return bool(np.any((limit < torque_that_acted_nm(problem)) & (limit < first)))


def pushes(state: JointState) -> bool:
    """Whether friction of some joint would drive it in one direction."""
    return any(motor_law.pushes(state.motor(j)) for j in range(state.joints))


def is_gravity(nominal_m_s2: np.ndarray, state: JointState) -> bool:
    """Whether a model's gravity is as strong as the nominal one, whatever its direction."""
    strength = float(np.linalg.norm(nominal_m_s2))
    return abs(float(np.linalg.norm(gravity_of(state, nominal_m_s2))) - strength) <= _GRAVITY_OFF * max(strength, 1.0)


def runs_into_bounds(state: JointState, start: JointState, accepted: Sequence[Accepted]) -> bool:
    """Whether any number of a cause is where the catalogue ends, and would have gone on."""
    for term in (term for a in accepted for term in a.terms):
        lower, upper = state.bounds(term.key)
        value, first = (float(each.value(term.key)[term.index]) for each in (state, start))
        near = _AT_BOUND * (upper - lower)
        if value != first and (value >= upper - near or (lower != first and value <= lower + near)):
            return True
    return False
