"""Which joints of a study could not be judged, or not all the time, and why."""

from collections.abc import Sequence

import numpy as np

from sim_backend.reality_gap.joints.equations import EpisodeEquations

_LEAST_SHARE = 0.01
"""Gaps that take less of the time hide nothing."""


def not_judged(episodes: Sequence[EpisodeEquations], names: Sequence[str]) -> list[str]:
    """A sentence for each joint of which nothing, or not everything, could be judged.

    Args:
        episodes: of a study, as they were judged.
        names: of the joints.
    """
    return [said for joint, name in enumerate(names) if (said := _of_joint(episodes, joint, name))]


def _of_joint(episodes: Sequence[EpisodeEquations], joint: int, name: str) -> str:
    if not any(e.has_torque[joint] for e in episodes):
        return f"anything about {name}: no torque of it is known"
    measured = np.concatenate([e.is_measured[:, joint] for e in episodes])
    if not measured.any():
        return f"anything about {name}: its torque, or a position of a joint that it moves with, is always missing"
    if not any(e.valid_mechanics[:, joint].any() for e in episodes):
        return f"anything else about {name}: no time is left in which its motor alone moves it"
    inner = np.concatenate([e.path.inner for e in episodes])
    share = 1.0 - float(measured.sum()) / max(float(inner.sum()), 1.0)
    if share < _LEAST_SHARE:
        return ""
    return f"what {name} does in {share:.0%} of the time: its torque, or a position of a joint that it moves with, is missing"
