"""Which joints of a study could not be judged, or not all the time, and why."""

from collections.abc import Sequence

import numpy as np

from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations

_LEAST_SHARE = 0.01
"""Gaps that take less of the time hide nothing."""


def not_judged(episodes: Sequence[EpisodeEquations], names: Sequence[str]) -> list[str]:
    """A sentence for each joint of which nothing, or not everything, could be judged, and for each channel with outliers.

    Args:
        episodes: of a study, as they were judged.
        names: of the joints.
    """
    return [said for joint, name in enumerate(names) if (said := _of_joint(episodes, joint, name))] + _of_outliers(episodes)


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


def _of_outliers(episodes: Sequence[EpisodeEquations]) -> list[str]:
    """Each channel of which samples were left out: how many, and where the first one was."""
    found: dict[tuple[str, str], list[str]] = {}
    for episode in episodes:
        for outlier in episode.path.joints.outliers:
            place = f"{episode.path.recording.name} at {outlier.time_s:.3f} s"
            found.setdefault((outlier.joint, outlier.channel), []).append(place)
    more = {key: f" and {len(places) - 1} more" if len(places) > 1 else "" for key, places in found.items()}
    return [
        f"whether the {channel} of {joint} was what it says in {places[0]}{more[joint, channel]}: "
        "far from the samples before and after, and left out"
        for (joint, channel), places in found.items()
    ]
