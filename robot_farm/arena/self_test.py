"""A robot tests itself: do its joints follow a known path, and does its tracker see a resting object as it must?

The limits for the tracker are those of the laboratory's own test after each submission (facts: TriFinger, 1.7); its test of the
joints allows 0.2 rad for all nine together (robot_fingers scripts/trifingerpro_post_submission.py, run_self_test).
"""

from collections.abc import Sequence

import numpy as np

from robot_farm.arena.motion import RAISED_RAD, START_RAD, Motion
from robot_farm.faults import CAMERA_NAMES
from sim_backend.driver.tracker import TrackedPose
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import Shape, resting_height_m

JOINT_TOLERANCE_RAD = 0.1
MIN_CONFIDENCE = 0.75
MAX_POSITION_ERROR_M = 0.020
MAX_HEIGHT_ERROR_M = 0.010
MAX_TURN_RAD = 0.2
LOOK_S = 1.2
"""Long enough for ten frames and their way through the tracker."""
LOOK_AGAIN_S = 18.0
"""A second look is longer, so that a few frames with a wrong orientation weigh less: a tracker that takes faces for each other in
2 % of the frames turns them by 0.2 rad on average in one of 28 looks of 6 s, and in one of 1,500 of 18 s (drawn)."""
_TURNED_UP = np.tile([1.0, 1.57, -2.7], 3)
_BOTH_ENDS = (
    (_TURNED_UP, 1.2),
    (np.tile([-0.33, 1.57, -2.7], 3), 1.2),
    (np.tile([0.0, 0.0, -2.7], 3), 1.4),
    (_TURNED_UP, 1.4),
)
"""The known path and the time for each part of it: to both ends of the first two joints' ranges and the folded end of the third,
so that a joint whose encoder is off runs into its stop on one side. The other end of the third is left out: the stretched arm
needs nearly the motor's whole torque. For the same reason arms are lifted while they are turned to the side: straight up, a
motor that is 8 % weak with a stiff joint stops 0.15 rad below the goal, and such a robot is in order."""
_SETTLE_S = 0.3


def try_joints(motion: Motion) -> str | None:
    """Move along the known path and compare, at the end of each part, where each joint is with where it should be.

    The first part that goes wrong is the last: a joint that does not move soon gets others into its way.

    Returns:
        What is wrong, as a sentence that names the joint; None if nothing is.
    """
    wrong = None
    motion.go_to(RAISED_RAD, 0.6)
    for pose_rad, duration_s in _BOTH_ENDS:
        motion.go_to(pose_rad, duration_s)
        wrong = wrong_joint(motion.hold(pose_rad, _SETTLE_S))
        if wrong is not None:
            break
    motion.go_to(RAISED_RAD, 0.8)
    motion.go_to(START_RAD, 0.5)
    return wrong


def wrong_joint(error_rad: np.ndarray) -> str | None:
    """The joint that is farthest from where it should be, as a sentence, if it is too far; errors of shape (9,), rad."""
    joint = int(np.abs(error_rad).argmax())
    if abs(error_rad[joint]) <= JOINT_TOLERANCE_RAD:
        return None
    return (
        f"joint {c.JOINT_NAMES[joint]} is {error_rad[joint]:+.2f} rad from where it should be "
        f"(allowed {JOINT_TOLERANCE_RAD:g}): stuck, blocked, or its encoder is off"
    )


def try_sight(motion: Motion, shape: Shape, look_s: float = LOOK_S) -> str | None:
    """Look at the resting object with the fingers out of the way and compare the reports with each other and the table."""
    motion.go_to(RAISED_RAD, 0.4)
    reports = look(motion, RAISED_RAD, look_s)
    motion.go_to(START_RAD, 0.5)
    motion.hold(START_RAD, _SETTLE_S)
    return wrong_sight(reports, shape)


def look(motion: Motion, pose_rad: np.ndarray, look_s: float) -> list[TrackedPose]:
    """The tracker's reports of images that are taken while the fingers keep still."""
    before = len(motion.reports)
    since_step = motion.step
    motion.hold(pose_rad, look_s)
    return [report for report in motion.reports[before:] if report.capture_step[0] >= since_step]


def wrong_sight(reports: Sequence[TrackedPose], shape: Shape) -> str | None:
    """What is wrong with reports (n = 1) of an object at rest, as a sentence; None if nothing is."""
    blind = blind_camera(reports)
    if blind is not None:
        return blind
    confidence = float(np.mean([report.confidence[0] for report in reports]))
    if confidence < MIN_CONFIDENCE:
        return f"the cameras see the resting object with a mean confidence of {confidence:.2f} (at least {MIN_CONFIDENCE:g})"
    position = np.array([report.raw_position_world_m[0] for report in reports])
    spread_m = float(np.abs(position - position.mean(axis=0)).mean(axis=0).max())
    if spread_m > MAX_POSITION_ERROR_M:
        return f"the cameras see the resting object {spread_m * 1000:.0f} mm off on average (allowed {MAX_POSITION_ERROR_M:g} m)"
    quats = np.array([report.raw_quat_wxyz[0] for report in reports])
    turn_rad, middle = _turns(quats)
    if turn_rad > MAX_TURN_RAD:
        return f"the cameras see the resting object turned by {turn_rad:.2f} rad on average (allowed {MAX_TURN_RAD:g})"
    height_m = float(position[:, 2].mean() - resting_height_m(shape, quats[middle]))
    if abs(height_m) > MAX_HEIGHT_ERROR_M:
        return f"the cameras see the resting object {height_m * 1000:+.0f} mm from its height (allowed {MAX_HEIGHT_ERROR_M:g} m)"
    return None


def blind_camera(reports: Sequence[TrackedPose]) -> str | None:
    """The camera that sees nothing of an object at rest, as a sentence."""
    if not reports:
        return "no camera reported anything"
    sees = np.any([report.visible_faces[0].any(axis=1) for report in reports], axis=0)
    blind = [name for name, seen in zip(CAMERA_NAMES, sees, strict=True) if not seen]
    if not blind:
        return None
    return f"{' and '.join(blind)} {'see' if len(blind) > 1 else 'sees'} nothing of the resting object"


def _turns(quats_wxyz: np.ndarray) -> tuple[float, int]:
    """Mean angle between each of k orientations and the most central of them, rad, and which one that is."""
    cosine = np.clip(np.abs(quats_wxyz @ quats_wxyz.T), 0.0, 1.0)
    mean_rad = (2 * np.arccos(cosine)).mean(axis=1)
    middle = int(mean_rad.argmin())
    return float(mean_rad[middle]), middle
