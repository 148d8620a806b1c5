"""One session as a short vector of numbers and two counts: what the tracker does, and what pushes leave unexplained."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.subjects.cube.contact import CONTACT_NAMES, ContactSummary, contact_summary
from sim_backend.reality_gap.subjects.cube.replay import PushReplay, Replayed
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics, tracker_statistics
from sim_backend.reality_gap.subjects.cube.windows import all_push_windows
from sim_backend.trifinger import constants as c

TRACKER_NAMES = ("delay_s", "log_delay_std", "log_interval", "log_noise_m", "log_noise_rad", "confidence", "rest_height_m")
NAMES = (*TRACKER_NAMES, *CONTACT_NAMES)
PLACED_NAMES = ("rest_height_m", *CONTACT_NAMES)
"""Those that say where the cube is and what forces it, which hang together."""
_SHORTEST_S, _SMALLEST = 1e-4, 1e-6


@dataclass(frozen=True)
class CubeEvidence:
    """What a session leaves to judge.

    Attributes:
        tracker: its statistics, None with too few reports.
        replayed: pushes.
        rest_height_m: where what pushes were replayed with has a cube at rest, beyond where a nominal one is.
    """

    tracker: TrackerStatistics | None
    replayed: tuple[Replayed, ...]
    rest_height_m: float = 0.0


@dataclass(frozen=True)
class CubeSummary:
    """A session.

    Attributes:
        vector: in the order of ``NAMES``, shape (k,); NaN where the log does not hold what is needed.
        contact: of its pushes, None without any.
        tracker: statistics that the first numbers are made of.
    """

    vector: np.ndarray
    contact: ContactSummary | None
    tracker: TrackerStatistics | None


def evidence_of(sessions: Sequence[Sequence[Recording]], replay: PushReplay) -> list[CubeEvidence]:
    """Of each session, recordings of one robot; the pushes of all are replayed together."""
    windows = [all_push_windows(recordings) for recordings in sessions]
    replayed = iter(replay.replay([window for pushes in windows for window in pushes]))
    return [
        CubeEvidence(tracker_statistics(recordings), tuple(next(replayed) for _ in pushes))
        for recordings, pushes in zip(sessions, windows, strict=True)
    ]


def summary_of_evidence(evidence: CubeEvidence) -> CubeSummary:
    """The summary of all that a session leaves."""
    return summary_of(evidence.tracker, contact_summary(evidence.replayed), evidence.rest_height_m)


def summary_of(tracker: TrackerStatistics | None, contact: ContactSummary | None, rest_height_m: float = 0.0) -> CubeSummary:
    """The summary of statistics of the tracker and of pushes, each of which may be missing; heights beyond ``rest_height_m``."""
    first = np.full(len(TRACKER_NAMES), np.nan) if tracker is None else _tracker_numbers(tracker)
    first[TRACKER_NAMES.index("rest_height_m")] -= rest_height_m
    second = np.full(len(CONTACT_NAMES), np.nan) if contact is None else contact.score
    return CubeSummary(np.concatenate([first, second]), contact, tracker)


def _tracker_numbers(tracker: TrackerStatistics) -> np.ndarray:
    return np.array(
        [
            tracker.delay_s - c.CAMERA_DELAY_S,
            np.log(max(tracker.delay_std_s, _SHORTEST_S)) if np.isfinite(tracker.delay_std_s) else np.nan,
            np.log(tracker.interval_s / c.CAMERA_PERIOD_S),
            np.log(max(tracker.rest_noise_m, _SMALLEST)),
            np.log(max(tracker.rest_noise_rad, _SMALLEST)),
            tracker.confidence,
            tracker.rest_height_m - c.CUBE_REST_HEIGHT_M,
        ]
    )
