"""Rows in which laws along a recorded motion can follow a joint of a robot that differs everywhere.

Where a joint sticks for a moment friction may hold anything, and where a motor's torque changes its sign a gear with play throws
the rotor from side to side. In a robot with many causes such rows leave ten to a hundred times what all others do, and the values
that mend them a little are wrong everywhere else.
"""

from collections.abc import Sequence

import numpy as np

from sim_backend.reality_gap.subjects.joints.torques.counted_rows import pauses, reverses
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations

_KEPT = 0.25
"""Share of each direction's rows that must be left: seen in one direction alone, dry friction is any other constant torque."""


def where_steady(episodes: Sequence[EpisodeEquations]) -> tuple[EpisodeEquations, ...]:
    """The same episodes, of whose mechanics only rows count around which a joint keeps moving and its torque keeps its sign.

    A joint whose torque changes its sign all the way in one direction, as that of a light link may, keeps its reversals.
    """
    moving = [episode.counting_only(~pauses(episode.path)) for episode in episodes]
    steady = [~reverses(episode.path, episode.acting_nm) for episode in episodes]
    forwards, backwards = _kept(moving, steady, 1.0), _kept(moving, steady, -1.0)
    keeps_both = (forwards >= _KEPT) & (backwards >= _KEPT)
    return tuple(episode.counting_only(rows | ~keeps_both) for episode, rows in zip(moving, steady, strict=True))


def _kept(episodes: Sequence[EpisodeEquations], steady: Sequence[np.ndarray], direction: float) -> np.ndarray:
    """Which share of the rows of each joint that moves in a direction are steady, shape (k,)."""
    counted = [e.valid_mechanics & (e.path.velocity * direction > 0.0) for e in episodes]
    kept = sum((rows & each).sum(axis=0) for rows, each in zip(counted, steady, strict=True))
    return np.asarray(kept / np.maximum(sum(rows.sum(axis=0) for rows in counted), 1))
