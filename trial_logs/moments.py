"""What happened in a trial and when, found from what was measured: the way of the object, and how fingertips hold it.

Fingertips are where the joints say, the object is where the tracker saw it, ten times a second and with errors of millimetres;
reports that it was not sure of repeat what was before, and are left out. So a fingertip counts as touching within ``TOUCH_M`` of
the object's surface, and what one report alone says is not believed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

LIFTED_M = 0.015
TOUCH_M = 0.008
LEFT_M = 0.016
"""A fingertip that touches does so until it is so far away."""
SLIP_M = 0.012
"""How far the place of a touch must move over the object within ``WITHIN_REPORTS``: a tip that rolls moves it by less."""
LASTING_M, LASTING_REPORTS = 0.008, 4
"""And how far it must have moved from the middle one of so many reports before to that of those after: noise has not."""
TURNED_M = 0.045
"""Farther than this no tip slips in that time: the tracker took one face for another."""
WITHIN_REPORTS = 3
LONGEST_S = 0.6
"""That so many reports may take; where the tracker was blind for longer, nobody knows what happened."""
HOLDING = 2
"""Fingertips at once that make a hold; one alone only pushes, and slides as it does."""
ELSEWHERE_M = 0.015
REGRASP_WITHIN_S = 2.0
ONCE_WITHIN_S = 0.8
"""Slips of one finger nearer to each other than this are one."""


@dataclass(frozen=True)
class Moment:
    """Something that happened; ``kind`` is ``ok``, ``not`` (something went wrong) or ``now``."""

    t_s: float
    text: str
    kind: str


@dataclass(frozen=True)
class Seen:
    """What was measured of object and fingertips at the same times.

    Args:
        t_s: when the object was seen, shape (n,).
        pose: of the object in the world, position in m and quaternion wxyz, shape (n, 7).
        tips_m: fingertips in the world at these times, shape (n, fingers, 3).
        half_m: half the object's extent along its axes, shape (3,); a ball has the same thrice.
        is_ball: whether it is one.
        tip_radius_m: of the fingertips.
        fingers: their names.
    """

    t_s: np.ndarray
    pose: np.ndarray
    tips_m: np.ndarray
    half_m: np.ndarray
    is_ball: bool
    tip_radius_m: float
    fingers: Sequence[str]


def way_of_object(t_s: np.ndarray, pose: np.ndarray, goal_m: np.ndarray | None, within_m: float) -> list[Moment]:
    """When the object came within so much of its goal or left it, and was lifted, put down or dropped."""
    found, height = [], pose[:, 2]
    rest = float(np.median(height[:5])) if len(height) else 0.0
    if goal_m is not None:
        away = np.linalg.norm(pose[:, :3] - goal_m, axis=1)
        for k, is_there in changes(len(t_s), lambda k, _: bool(away[k] < within_m)):
            found.append(Moment(float(t_s[k]), "at the goal" if is_there else "left the goal", "ok" if is_there else "not"))
    for k, is_up in changes(len(t_s), lambda k, up: bool(height[k] - rest > (0.4 if up else 1.0) * LIFTED_M)):
        fell = not is_up and height[max(0, k - 3)] - height[k] > LIFTED_M
        text = "lifted" if is_up else "dropped" if fell else "put down"
        at_s = 0.5 * (t_s[k - 1] + t_s[k]) if fell else t_s[k]
        found.append(Moment(float(at_s), text, "not" if fell else "now"))
    return found


def changes(count: int, holds: Callable[[int, bool], bool]) -> list[tuple[int, bool]]:
    """The samples at which a condition begins or ends; one sample alone is taken for a jump of the tracker."""
    found, now = [], False
    for k in range(1, count - 1):
        if holds(k, now) != now and holds(k + 1, now) != now:
            now = not now
            found.append((k, now))
    return found


def holds_of_fingers(seen: Seen) -> list[Moment]:
    """When a fingertip slipped over the object that it helped to hold, and when one took hold elsewhere."""
    if len(seen.t_s) < WITHIN_REPORTS + 2:
        return []
    places = in_object(seen.tips_m, smoothed(seen.pose))
    gap_m = surface_distance(places, seen.half_m, is_ball=seen.is_ball) - seen.tip_radius_m
    touching = np.stack([_touching(gap_m[:, finger]) for finger in range(gap_m.shape[1])], axis=1)
    held = touching.sum(axis=1) >= HOLDING
    found = []
    for finger, name in enumerate(seen.fingers):
        holding = touching[:, finger] & held & (gap_m[:, finger] < TOUCH_M)
        found += _slips(seen.t_s, places[:, finger], holding, name)
        found += _regrasps(seen.t_s, places[:, finger], touching[:, finger], name)
    return found


def _touching(gap_m: np.ndarray) -> np.ndarray:
    """Whether a fingertip touches, for each report; a change that the next report takes back is none."""
    touching, now = np.zeros(len(gap_m), bool), bool(gap_m[0] < TOUCH_M)
    for k in range(len(gap_m)):
        following = gap_m[min(k + 1, len(gap_m) - 1)]
        if now and gap_m[k] > LEFT_M and following > LEFT_M:
            now = False
        elif not now and gap_m[k] < TOUCH_M and following < TOUCH_M:
            now = True
        touching[k] = now
    return touching


def _slips(t_s: np.ndarray, place_m: np.ndarray, holding: np.ndarray, name: str) -> list[Moment]:
    found, last_s = [], -np.inf
    held = np.all(np.lib.stride_tricks.sliding_window_view(holding, WITHIN_REPORTS + 1), axis=1)
    moved_m = np.linalg.norm(place_m[WITHIN_REPORTS:] - place_m[:-WITHIN_REPORTS], axis=1)
    slides = held & (moved_m >= SLIP_M) & (moved_m < TURNED_M)
    for k in WITHIN_REPORTS + np.flatnonzero(slides[:-1]):  # what the last report alone shows may be a jump of the tracker
        first, last = np.searchsorted(t_s, (t_s[k - WITHIN_REPORTS] - LONGEST_S / 2, t_s[k] + LONGEST_S / 2))
        before, after = place_m[first : k - WITHIN_REPORTS + 1][-LASTING_REPORTS:], place_m[k : last + 1][:WITHIN_REPORTS]
        lasting_m = float(np.linalg.norm(np.median(after, axis=0) - np.median(before, axis=0)))
        if lasting_m < LASTING_M or t_s[k] - t_s[k - WITHIN_REPORTS] > LONGEST_S:
            continue
        if t_s[k] - last_s > ONCE_WITHIN_S:
            found.append(Moment(float(t_s[k]), f"{name} slipped by {1e3 * moved_m[k - WITHIN_REPORTS]:.0f} mm", "not"))
        last_s = float(t_s[k])
    return found


def _regrasps(t_s: np.ndarray, place_m: np.ndarray, touching: np.ndarray, name: str) -> list[Moment]:
    found = []
    ends = np.flatnonzero(touching[:-1] & ~touching[1:])
    for end in ends:
        begins = np.flatnonzero(touching[end + 1 :])
        if not len(begins):
            continue
        begin = end + 1 + int(begins[0])
        moved_m = float(np.linalg.norm(place_m[begin] - place_m[end]))
        if t_s[begin] - t_s[end] <= REGRASP_WITHIN_S and moved_m > ELSEWHERE_M:
            found.append(Moment(float(t_s[begin]), f"{name} took hold again, {1e3 * moved_m:.0f} mm away", "now"))
    return found


def smoothed(pose: np.ndarray) -> np.ndarray:
    """The poses with each position and orientation the middle one of three reports, so that a single jump is not seen."""
    out = pose.copy()
    if len(pose) < 3:
        return out
    before, here, after = pose[:-2], pose[1:-1], pose[2:]
    out[1:-1, :3] = np.median([before[:, :3], here[:, :3], after[:, :3]], axis=0)
    is_jump = np.maximum(_alike(here, before), _alike(here, after)) < _alike(before, after)
    out[1:-1, 3:][is_jump] = before[is_jump, 3:]
    return out


def _alike(some: np.ndarray, others: np.ndarray) -> np.ndarray:
    """How near the orientations of poses of shape (n, 7) are to those of others, up to 1, shape (n,)."""
    return np.abs(np.sum(some[:, 3:] * others[:, 3:], axis=1))


def in_object(points_m: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Points in the world, shape (n, m, 3), in the frames of poses of shape (n, 7)."""
    return np.einsum("nij,nmi->nmj", turns(pose[:, 3:]), points_m - pose[:, None, :3])


def turns(quat_wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrices, shape (n, 3, 3), of quaternions of shape (n, 4) and any length but zero."""
    length = np.linalg.norm(quat_wxyz, axis=1, keepdims=True)
    w, x, y, z = (quat_wxyz / np.where(length > 0, length, 1.0)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def surface_distance(points_m: np.ndarray, half_m: np.ndarray, *, is_ball: bool) -> np.ndarray:
    """Distance of points in the object's frame, shape (..., 3), from its surface; negative inside."""
    if is_ball:
        return np.linalg.norm(points_m, axis=-1) - half_m[0]
    beyond = np.abs(points_m) - half_m
    return np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(axis=-1), 0)
