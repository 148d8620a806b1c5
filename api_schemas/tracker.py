"""The kinds of trackers that find the object for a robot."""

from enum import StrEnum


class TrackerName(StrEnum):
    """What a farm's robots find the object with."""

    POSE = "pose"  # a formula of the true pose: delay, noise, dropouts, what fingers hide
    IMAGES = "images"  # a network and a fit on rendered images of three cameras


def told_trackers(trackers: tuple[str, ...]) -> str:
    """The trackers of a job's trials in words."""
    if len(trackers) < 2:
        return trackers[0] if trackers else TrackerName.POSE.value
    return f"{' and '.join(trackers)}: its trials are of different trackers"
