"""Joints near the ends of their ranges, where something else than a motor may act, so that nothing there is judged."""

from collections.abc import Sequence

import numpy as np

from sim_backend.reality_gap.subjects.joints.slides import told_range
from sim_backend.reality_gap.subjects.joints.torques.counted_rows import near_end
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations

_LEAST_SHARE, _MOSTLY = 0.01, 0.5
"""Of the rows: less hides nothing; a robot that is there in more of them has other ends than its model."""


def sentences_on_ends(episodes: Sequence[EpisodeEquations], names: Sequence[str]) -> list[str]:
    """Of joints that come near ends: where the model has these, and where the robot went.

    Args:
        episodes: of a study.
        names: of the joints.
    """
    plant, shares, said = episodes[0].plant, _shares(episodes), []
    for j in map(int, np.flatnonzero(shares >= _LEAST_SHARE)):
        known = np.concatenate([e.path.joints.position_rad[:, j] for e in episodes])
        in_model, in_data = (
            told_range(float(low), float(high), is_slide=bool(plant.is_slide[j]))
            for low, high in (plant.range_rad[j], (np.nanmin(known), np.nanmax(known)))
        )
        said.append(
            f"what {names[j]} does in {shares[j]:.0%} of the time: near an end of its range, or beyond it, something else than "
            f"its motor may act (the model has it from {in_model}, and it went from {in_data})"
        )
    return said


def mostly_at_ends(episodes: Sequence[EpisodeEquations], names: Sequence[str]) -> list[str]:
    """Joints that are near an end, or beyond it, most of the time; as of :func:`sentences_on_ends`."""
    return [name for name, share in zip(names, _shares(episodes), strict=True) if share > _MOSTLY]


def _shares(episodes: Sequence[EpisodeEquations]) -> np.ndarray:
    """In which share of the rows with positions each joint is near an end, or beyond it, shape (k,)."""
    known = np.concatenate([e.path.valid for e in episodes])
    near = np.concatenate([near_end(e.path, e.ends_rad) for e in episodes])
    return np.asarray((near & known).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
