"""A joint whose zero seems to lie elsewhere may be right: the robot hangs where its model stands, or is mounted on a wall."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.reality_gap.subjects.joints.verdicts.heavier_links import left_with
from sim_backend.reality_gap.subjects.joints.verdicts.readings import ToldEpisode
from sim_backend.reality_gap.subjects.joints.verdicts.ways_to_misread import FALLS_TO, Misreading

_AS_LARGE = 0.1
"""Share of gravity by which one that only pulls another way may be larger or smaller, as a model is a little off."""


def or_turned_gravity(found: Misreading, data: Sequence[ToldEpisode]) -> Misreading:
    """A reading of a zero, beside a gravity that pulls another way where that does about as well at all joints.

    Args:
        found: a reading; any other one is left as it is.
        data: as it is told.
    """
    if not np.any(found.reading.zeros_rad):
        return found
    more, left = left_with(data, [told.episode.dynamics.by_gravity for told in data])
    nominal, known = data[0].episode.plant.gravity_m_s2, np.isfinite(found.after_nm)
    size = float(np.linalg.norm(nominal))
    if abs(float(np.linalg.norm(nominal + more)) - size) > _AS_LARGE * size or (left > found.after_nm / FALLS_TO)[known].any():
        return found
    check = f"{found.check}, and which way gravity pulls in the model,"
    return replace(found, said=f"{found.said}, or gravity pulls another way", check=check)
