"""The most that any explanation could gain: a flexible network, fitted to what a model leaves and asked on held-out stretches.

One hidden layer whose weights are drawn and kept, and an output layer by ridge regression (random features): its fit is exact,
quick, and the same on every machine. It sees the motion and the torques of all joints, and a joint's own time since it turned
round and heat, so that it can stand in for any law of these.
"""

from collections.abc import Sequence

import numpy as np
from scipy import linalg

from sim_backend.reality_gap.subjects.joints.gain import folds_of_rows
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import FOLDS
from sim_backend.reality_gap.subjects.joints.torques.residual_patterns import heat, since_reversal_s

UNITS = 256
_RIDGES = (1e-3, 1e-1, 10.0, 1e3)
_MOST_ROWS = 20_000
_TURN_RAD_S = 0.05


def network_error_nm(episodes: Sequence[EpisodeEquations], state: JointState, rng: np.random.Generator) -> float:
    """Held-out root mean square torque error over all joints when a network corrects a model; N m.

    Each fold is predicted by a network that was fitted to the others, with the ridge that predicts a further fold best.

    Args:
        episodes: of the study.
        state: the model.
        rng: draws the hidden layer.
    """
    valid = np.concatenate([e.valid_mechanics for e in episodes])
    left = np.concatenate([e.torque_error(state) for e in episodes])
    fold = np.concatenate([folds_of_rows(e, len(episodes)) for e in episodes])
    common = np.concatenate([_motion(e) for e in episodes])
    own = np.concatenate([_history(e) for e in episodes])
    squares = rows = 0.0
    for joint in range(left.shape[1]):
        used = np.flatnonzero(valid[:, joint])
        used = used[:: max(1, len(used) // _MOST_ROWS)]
        if len(used) < 4 * UNITS:
            squares, rows = squares + float(left[used, joint] @ left[used, joint]), rows + len(used)
            continue
        hidden = _hidden(np.concatenate([common[used], own[used, :, joint]], axis=1), rng)
        error = _corrected(hidden, left[used, joint], fold[used])
        squares, rows = squares + float(error @ error), rows + len(used)
    return float(np.sqrt(squares / max(rows, 1.0)))


def _motion(e: EpisodeEquations) -> np.ndarray:
    """Positions, velocities, their signs, accelerations and torques of all joints, shape (t, 5 k)."""
    torque = e.path.averaged(e.driving_nm).T
    sign = np.tanh(e.path.velocity / _TURN_RAD_S)
    return np.concatenate([e.path.position, e.path.velocity, sign, e.path.acceleration, torque], axis=1)


def _history(e: EpisodeEquations) -> np.ndarray:
    """Load against the motion, time since a joint turned round, and heat, shape (t, 3, k)."""
    torque, row_s = e.path.averaged(e.driving_nm).T, e.path.step_s * e.path.every
    against = torque * np.tanh(e.path.velocity / _TURN_RAD_S)
    return np.stack([against, since_reversal_s(e.path.velocity, row_s), heat(torque, row_s)], axis=1)


def _hidden(inputs: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Inputs of unit variance and their drawn tanh units, and a constant; shape (r, m)."""
    spread = inputs.std(axis=0)
    scaled = (inputs - inputs.mean(axis=0)) / np.where(spread > 1e-9, spread, 1.0)
    weights = rng.standard_normal((inputs.shape[1], UNITS)) * 1.5 / np.sqrt(inputs.shape[1])
    units = np.tanh(scaled @ weights + rng.uniform(-1.5, 1.5, UNITS))
    return np.concatenate([np.ones((len(inputs), 1)), scaled, units], axis=1)


def _corrected(hidden: np.ndarray, left: np.ndarray, fold: np.ndarray) -> np.ndarray:
    """What is left of each row by a network that has not seen its fold, shape (r,)."""
    grams = np.zeros((FOLDS, hidden.shape[1], hidden.shape[1]))
    crosses = np.zeros((FOLDS, hidden.shape[1]))
    for f in range(FOLDS):
        mine = hidden[fold == f]
        grams[f], crosses[f] = mine.T @ mine, mine.T @ left[fold == f]
    gram, cross = grams.sum(axis=0), crosses.sum(axis=0)
    out = left.copy()
    present = np.unique(fold)
    for at, f in enumerate(present):
        asked, other = fold == f, fold == present[(at + 1) % len(present)]
        tried = [_output(gram - grams[f], cross - crosses[f], ridge) for ridge in _RIDGES]
        if len(present) > 2:
            nested = present[(at + 1) % len(present)]
            inner = [_output(gram - grams[f] - grams[nested], cross - crosses[f] - crosses[nested], ridge) for ridge in _RIDGES]
            best = int(np.argmin([np.sum((left[other] - hidden[other] @ w) ** 2) for w in inner]))
        else:
            best = len(_RIDGES) - 1
        out[asked] = left[asked] - hidden[asked] @ tried[best]
    return out


def _output(gram: np.ndarray, cross: np.ndarray, ridge: float) -> np.ndarray:
    scale = ridge * np.trace(gram) / len(gram)
    return linalg.solve(gram + scale * np.eye(len(gram)), cross, assume_a="pos")
