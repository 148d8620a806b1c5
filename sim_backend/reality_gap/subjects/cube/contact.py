"""Replayed pushes as a few numbers: how far their residuals point in the direction in which each hypothesis would move them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.knowledge.cube import DIRECTIONS, TRIALS, UNSURE, Trial
from sim_backend.reality_gap.subjects.cube.replay import Replayed

_CHANNEL_STD = np.array([0.1, 0.1, 0.2, 0.45, 0.45, 0.4])
"""What is left in each channel of a healthy push away from impacts, in units of the channel's weight."""
_BEFORE_CONTACT_S = 0.10
BEND = 6.0
"""Standard deviations beyond which a residual counts by its logarithm: a spike of an impact that came early says little more."""
_USUAL_SIZE, _TOLERATED = 1.1, 1.3
"""Root mean square of a healthy push's weighted residual, and how far a push may exceed the session's before it counts less."""

_FORCES = ("along", "across", "up")
CONTACT_NAMES = (
    *DIRECTIONS,
    *(f"force_{name}" for name in _FORCES),
    *(f"force_{name}_before_contact" for name in _FORCES),
)
"""Directions that residuals are looked at in; a force that is there before the contact is not the cube's doing."""


@dataclass(frozen=True)
class ContactSummary:
    """Of all pushes of a session.

    Attributes:
        pushes: how many.
        score: in the order of ``CONTACT_NAMES``, shape (k,): residuals projected on unit directions.
        response: by effect, the values tried, shape (v,), and what the score would be, shape (v, k); nominal is not among them.
    """

    pushes: int
    score: np.ndarray
    response: Mapping[str, tuple[np.ndarray, np.ndarray]]


def contact_summary(replayed: Sequence[Replayed], trials: Sequence[Trial] = TRIALS) -> ContactSummary | None:
    """The summary of replayed pushes; None without one."""
    if not replayed:
        return None
    index = {(trial.effect, trial.value): i for i, trial in enumerate(trials)}
    residual = np.concatenate([push.residual.T for push in replayed])
    channel, times = (np.concatenate([getattr(push, name) for push in replayed]) for name in ("channel", "time_s"))
    unsure = sum((share * (residual[:, 0] - residual[:, index[key]])) ** 2 for key, share in UNSURE.items())
    residual = residual / np.sqrt(_CHANNEL_STD[channel] ** 2 + unsure)[:, None]
    sizes = [len(push.channel) for push in replayed]
    weight = np.repeat(_push_weights(residual, sizes), sizes)
    residual = BEND * np.arcsinh(residual / BEND)
    moved = residual[:, :1] - residual
    directions = np.stack(_directions(moved, channel, times, index))
    weighted = directions * weight
    weighted /= np.sqrt(np.maximum((weighted * directions).sum(axis=1), 1e-12))[:, None]
    response = {
        effect: (
            np.array([trial.value for trial in trials if trial.effect == effect]),
            np.stack([weighted @ moved[:, i] for i, trial in enumerate(trials) if trial.effect == effect]),
        )
        for effect in dict.fromkeys(trial.effect for trial in trials[1:])
    }
    return ContactSummary(len(replayed), weighted @ residual[:, 0], response)


def _push_weights(residual: np.ndarray, sizes: Sequence[int]) -> np.ndarray:
    """Weight of each push, shape (pushes,): one that fits far worse than the others counts less.

    Whether a cube tips or turns hangs, in some pushes, on a tenth of a millimetre. How ill a push fits is the geometric mean of
    how ill it fits nominally and under its best trial, so that a cause that shows in few pushes does not pass for an accident.
    """
    squares = [(part**2).mean(axis=0) for part in np.split(residual, np.cumsum(sizes)[:-1])]
    size = np.array([(square[0] * square.min()) ** 0.25 for square in squares])
    return 1.0 / np.maximum(1.0, size / (_TOLERATED * max(_USUAL_SIZE, float(np.median(size)))))


def _directions(
    moved: np.ndarray, channel: np.ndarray, times: np.ndarray, index: Mapping[tuple[str, float], int]
) -> list[np.ndarray]:
    """Unscaled directions, each of shape (k,), in the order of ``CONTACT_NAMES``; ``moved`` has shape (k, trials)."""
    found = [moved[:, index[plus]] - (moved[:, index[minus]] if minus else 0.0) for plus, minus in DIRECTIONS.values()]
    constant = [(channel == axis).astype(float) for axis in range(3)]
    return found + constant + [row * (times < _BEFORE_CONTACT_S) for row in constant]
