"""What a change of a model, and of where windows begin, does to where a robot goes in them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts.forward import Forward, Windows

_STARTS = (2e-3, 0.2)
"""Standard deviations of where windows begin, rad and rad/s, about the smoothed motion."""
PROBES = (1e-3, 1e-2)
"""By which begins are moved to see what that does, rad and rad/s."""
SAMPLES_OF_WINDOW = 4.0
"""Independent numbers that a joint's errors in a window count as: they are as smooth as the motion."""


@dataclass(frozen=True)
class Linearised:
    """Errors of all windows at a model, and what each term changes in them, free of where windows begin.

    Attributes:
        error: measured less simulated, shape (n, s, k), rad.
        precision, pull: sums of squares of the terms' changes and with the errors, in units of the noise, (m, m) and (m,).
        starts: for each window, what its start follows from a change of the terms: (change of start, by terms).
        moves: what each term, and after them where windows begin, changes in positions, shape (m + 2 k, n, s, k).
    """

    error: np.ndarray
    precision: np.ndarray
    pull: np.ndarray
    starts: tuple[np.ndarray, np.ndarray]
    moves: np.ndarray


def linearised(
    forward: Forward,
    windows: Windows,
    state: JointState,
    terms: Sequence[Term],
    begin: tuple[np.ndarray, np.ndarray],
    noise: np.ndarray,
    weights: np.ndarray,
    known: np.ndarray | None = None,
) -> Linearised:
    """Errors at a model and what a change of each term does to them.

    Args:
        forward: simulates windows.
        windows: n of them, of k joints.
        state: the model.
        terms: m of them.
        begin: where windows begin.
        noise: of each joint, shape (k,), rad.
        weights: of each window and joint, shape (n, k).
        known: what the last of the terms, and where windows begin, change, as :class:`Linearised` of a model nearby has them;
            they are not probed then.
    """
    k = begin[0].shape[1]
    m = len(terms)
    anew = m if known is None else m + 2 * k - len(known)
    went, moves = probed(forward, windows, state, terms[:anew], begin, with_begins=known is None)
    moves = moves if known is None else np.concatenate([moves, known])
    error = windows.position_rad - went
    fine = np.asarray(np.isfinite(error).all(axis=(1, 2)) & np.isfinite(moves).all(axis=(0, 2, 3)))
    counted = (np.sqrt(weights * SAMPLES_OF_WINDOW / error.shape[1]) / noise)[:, None] * fine[:, None, None]
    left, images = error * counted, (moves * counted).swapaxes(0, 1)
    left[~fine], images[~fine] = 0.0, 0.0
    left, images = left.reshape(len(error), -1, 1), images.reshape(len(error), m + 2 * k, -1)
    products, pulls = images @ images.transpose(0, 2, 1), (images @ left)[:, :, 0]
    deviation = np.concatenate([windows.begin_rad - begin[0], windows.begin_rad_s - begin[1]], axis=1)
    held = np.repeat(1.0 / np.array(_STARTS) ** 2, k)
    block = products[:, m:, m:] + np.diag(held)
    pulled = pulls[:, m:] + held * deviation
    cross = products[:, m:, :m]
    free = np.linalg.solve(block, pulled[:, :, None])[:, :, 0]
    by_terms = np.linalg.solve(block, cross)
    precision = products[:, :m, :m].sum(axis=0) - np.einsum("nam,nal->ml", cross, by_terms)
    pull = pulls[:, :m].sum(axis=0) - np.einsum("nam,na->m", cross, free)
    return Linearised(error, precision, pull, (free, by_terms), moves)


def probed(
    forward: Forward,
    windows: Windows,
    state: JointState,
    terms: Sequence[Term],
    begin: tuple[np.ndarray, np.ndarray],
    *,
    with_begins: bool = True,
) -> tuple[np.ndarray, np.ndarray]:
    """Where a model goes, shape (n, s, k), and what terms, then places and speeds of begins change there, (m + 2 k, n, s, k)."""
    n, k = begin[0].shape
    models = [state, *(state.moved(t, t.probe) for t in terms)]
    m, b = len(terms), k if with_begins else 0
    total = 1 + m + 2 * b
    places, speeds = (np.tile(each, (total, 1, 1)) for each in begin)
    for j in range(b):
        places[1 + m + j, :, j] += PROBES[0]
        speeds[1 + m + k + j, :, j] += PROBES[1]
    which = np.repeat([*range(1 + m), *[0] * (2 * b)], n)
    over = np.tile(np.arange(n), total)
    went = forward.positions(windows, places.reshape(-1, k), speeds.reshape(-1, k), models, which, over)
    went = went.reshape(total, n, -1, k)
    steps = np.array([*(t.probe for t in terms), *[PROBES[0]] * b, *[PROBES[1]] * b])
    return went[0], (went[1:] - went[0]) / steps[:, None, None, None]
