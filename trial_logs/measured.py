"""What was measured of a trial, and what follows from it: how far the object was from its goal and when, and when it moved.

Distances are by the tracker, which is off by millimetres; what the judges say of the end corrects them about where that was.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trial_logs.moments import Moment, Seen, holds_of_fingers, in_object, smoothed, surface_distance, turns

STILL_M, STILL_S = 0.006, 3.0
QUICK_M = 0.008
"""Farther than this from one second to the next no object moves that creeps."""
MOVES_M = 0.02
FAR_M = 0.03
"""And who came farther in all went somewhere."""
NEAR_END_S = 1.0
IN_A_ROW = 4
"""So many reports of the tracker are believed."""
HEIGHT_M = 0.015
PASSED_S = 1.0
"""An object that was at its goal for less than this in all has passed it; what came then is told."""
EDGE_M = 0.003
"""Who is no farther out than this has not left the goal."""
JUST_M, LAST = 0.005, 5
"""So little outside at the end is just outside, whatever the last reports say."""
INSIDE_M = 0.002
"""And who was never farther inside than this has not been there."""
ALIKE_M, WRONG_M = 0.03, 0.01
"""As near as this to where it ended, the tracker's error is taken for that at the end, if it is no larger than that."""
WAVERED = 3
"""Who comes to the goal so often wavers about its edge."""


@dataclass(frozen=True)
class Evidence:
    """What was measured of a trial, and what was asked.

    Args:
        seen: the object by the tracker's reports that it was sure of, at the times of their frames, with the fingertips then.
        duration_s: of the trial as it ran.
        goal_m: wanted position of the object, shape (3,); None where fingertips have goals.
        goal_quat_wxyz: shape (4,), where the orientation counts, else None.
        tips_away_m: of the fingertips from their goals at m times, shape (m, fingers), or None.
        velocity_rad_s: of the joints at m times, shape (m, joints).
        applied_nm: torques, shape (m, joints).
        joints: their names.
        max_torque_nm: the limit of the joints.
        wall_m: inner radius of the arena.
        within_m: how near to its goal the object must end.
        within_rad: the same of its orientation.
        judged_error_m: position error at the end by the judges, None if they had none.
    """

    seen: Seen
    duration_s: float
    goal_m: np.ndarray | None
    goal_quat_wxyz: np.ndarray | None
    tips_away_m: np.ndarray | None
    velocity_rad_s: np.ndarray
    applied_nm: np.ndarray
    joints: Sequence[str]
    max_torque_nm: float
    wall_m: float
    within_m: float
    within_rad: float
    judged_error_m: float | None


def is_up(e: Evidence, t_s: float | None = None) -> bool:
    """Whether the object is in the air at a time, or at the end."""
    height_m, last = e.seen.pose[:, 2], len(e.seen.t_s) if t_s is None else max(int(np.searchsorted(e.seen.t_s, t_s)), 1)
    return float(np.median(height_m[max(0, last - 5) : last]) - np.median(height_m[:5])) > HEIGHT_M


def visits_of(e: Evidence) -> list[tuple[float, float | None]]:
    """From when until when the object was at its goal; None where it has gone no farther since than to the goal's edge."""
    error_m = np.linalg.norm(smoothed(e.seen.pose)[:, :3] - e.goal_m, axis=1) + wrong_m(e)
    near = (goal_error_m(e) < e.within_m + EDGE_M) | (error_m < e.within_m - INSIDE_M)
    lasting_m = _middle(error_m, 4)
    bounds = np.flatnonzero(np.diff(near, prepend=False, append=False))
    visits: list[tuple[float, float | None]] = []
    for since, until in zip(bounds[::2], bounds[1::2], strict=True):
        inside = since + np.flatnonzero(error_m[since:until] < e.within_m)
        if len(inside) < 2 or error_m[inside].min() > e.within_m - INSIDE_M:  # one report alone is no visit
            continue
        is_there = until == len(near) or (until >= len(near) - LAST and ended_m(e) < e.within_m + JUST_M)
        surely = since + np.flatnonzero(lasting_m[since:until] < e.within_m)
        left_s = None if is_there else float(e.seen.t_s[(surely if len(surely) else inside)[-1] + 1])
        visits.append((0.0 if since == 0 else float(e.seen.t_s[inside[0]]), left_s))
    return visits


def stays_s(e: Evidence, visits: Sequence[tuple[float, float | None]]) -> list[float]:
    """How long each visit was."""
    return [(e.duration_s if until is None else until) - since for since, until in visits]


def has_passed(e: Evidence, visits: Sequence[tuple[float, float | None]]) -> bool:
    """Whether all visits were too short, and too few, to say that the object was at its goal."""
    return 0 < len(visits) < WAVERED and max(stays_s(e, visits)) < PASSED_S


def last_gap_m(e: Evidence) -> float:
    """Of the nearest finger at the end."""
    return float(np.median(gaps_m(e)[-10:], axis=0).min())


def put_at_goal(e: Evidence, t_s: float) -> bool:
    """Whether an object whose goal is on the table came down at it: then it was put there, however fast."""
    assert e.goal_m is not None, "objects have goals"
    on_table = e.goal_m[2] - float(np.median(e.seen.pose[:5, 2])) < HEIGHT_M
    landed = np.flatnonzero(e.seen.t_s >= t_s)[:5]
    away_m = np.linalg.norm(e.seen.pose[landed, :2] - e.goal_m[:2], axis=1)
    return on_table and len(landed) > 0 and float(np.median(away_m)) < e.within_m


def slips_of(e: Evidence) -> list[Moment]:
    """When fingertips slipped over the object that they helped to hold."""
    return [moment for moment in holds_of_fingers(e.seen) if "slipped" in moment.text]


def goal_error_m(e: Evidence) -> np.ndarray:
    """Distance of the object from its goal, shape (n,): by the tracker, less what that is known to be wrong by."""
    return seen_goal_error_m(e) + wrong_m(e)


def wrong_m(e: Evidence) -> np.ndarray:
    """By how much the tracker has the object nearer to its goal than it is, shape (n,): as at the end, about where it ended."""
    wrong_m = 0.0 if e.judged_error_m is None else e.judged_error_m - float(np.median(seen_goal_error_m(e)[-5:]))
    away_m = np.linalg.norm(e.seen.pose[:, :3] - np.median(e.seen.pose[-5:, :3], axis=0), axis=1)
    return np.where(away_m < ALIKE_M, wrong_m if abs(wrong_m) < WRONG_M else 0.0, 0.0)


def seen_goal_error_m(e: Evidence) -> np.ndarray:
    """Distance of the object from its goal by the tracker, the middle one of five reports, shape (n,)."""
    error_m = np.linalg.norm(e.seen.pose[:, :3] - e.goal_m, axis=1)
    return _middle(error_m, 2)


def _middle(values: np.ndarray, reach: int) -> np.ndarray:
    """The middle one of each value and so many before and after it, shape (n,)."""
    padded = np.pad(values, reach, mode="edge")
    return np.median([padded[at : at + len(values)] for at in range(2 * reach + 1)], axis=0)


def _middle_row(rows: np.ndarray) -> np.ndarray:
    """The same numbers as ``np.median(rows, axis=0)``, which takes some times as long for few rows."""
    ordered = np.sort(rows, axis=0)
    return (ordered[(len(rows) - 1) // 2] + ordered[len(rows) // 2]) / 2


def _angles(e: Evidence) -> np.ndarray:
    assert e.goal_quat_wxyz is not None, "the orientation counts"
    return 2 * np.arccos(np.clip(np.abs(e.seen.pose[:, 3:] @ e.goal_quat_wxyz), 0.0, 1.0))


def turned_rad(e: Evidence) -> float:
    """How far the object was turned away from its goal at the end: the middle one of the last second's reports, or of the last
    three while it moved, in rad.
    """
    last = slice(-3, None) if moves_at_end(e) else e.seen.t_s > e.seen.t_s[-1] - NEAR_END_S
    return float(np.median(_angles(e)[last]))


def least_turned_rad(e: Evidence, visits: Sequence[tuple[float, float | None]]) -> float:
    """The least that the object was turned away from its goal while it visited that, rad; 0 where no orientation counts."""
    if e.goal_quat_wxyz is None:
        return 0.0
    at_goal = np.zeros(len(e.seen.t_s), bool)
    for since, until in visits:
        at_goal |= (e.seen.t_s >= since) & (e.seen.t_s < (np.inf if until is None else until))
    return float(_middle(_angles(e), 2)[at_goal].min()) if at_goal.any() else 0.0


def gaps_m(e: Evidence) -> np.ndarray:
    """From each fingertip to the object's surface, shape (n, fingers)."""
    places = in_object(e.seen.tips_m, e.seen.pose)
    return surface_distance(places, e.seen.half_m, is_ball=e.seen.is_ball) - e.seen.tip_radius_m


def reach_m(e: Evidence) -> np.ndarray:
    """How far from the middle of the arena the object's outermost corner was, shape (n,)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    pose = smoothed(e.seen.pose)
    corners_m = pose[:, None, :2] + np.einsum("nij,cj->nci", turns(pose[:, 3:])[:, :2], signs * e.seen.half_m)
    return np.linalg.norm(corners_m, axis=2).max(axis=1)


def highest_m(e: Evidence) -> float:
    """The greatest height of the object above where it began that lasted for some reports, m."""
    return float(_middle(e.seen.pose[:, 2], 4).max() - np.median(e.seen.pose[:5, 2]))


def moves_at_end(e: Evidence) -> bool:
    """Whether the object moved in the last second, when what the tracker says is old by the time of the judgement."""
    position_m = smoothed(e.seen.pose)[e.seen.t_s > e.seen.t_s[-1] - NEAR_END_S, :3]
    return float(np.linalg.norm(np.ptp(position_m, axis=0))) > MOVES_M


def calm_since(e: Evidence, quick_m: float = QUICK_M) -> tuple[float, float] | None:
    """Since when the object lies still or creeps, if for ``STILL_S`` at least, and how far it is from where it was then, m.

    ``quick_m``: one that moves farther from one second to the next does neither.
    """
    t_s, position_m = e.seen.t_s, smoothed(e.seen.pose)[:, :3]
    begins, ends = (np.searchsorted(t_s, t_s + shift_s, side="right").tolist() for shift_s in (-1.0, 1.0))
    settled_m, first = _middle_row(position_m[: ends[0]]), 0
    for k in reversed(range(len(t_s) - 1)):  # the last time that it moved
        before_m = _middle_row(position_m[begins[k] : k + 1])
        after_m = _middle_row(position_m[k + 1 : max(ends[k], k + 2)])
        if np.linalg.norm(before_m - after_m) > quick_m:
            away = np.flatnonzero(np.linalg.norm(position_m[begins[k] : ends[k]] - after_m, axis=1) > STILL_M)
            settled_m, first = after_m, begins[k] + (int(away[-1]) + 1 if len(away) else 0)
            break
    since = float(t_s[min(first, len(t_s) - 1)]) if first else 0.0
    crept_m = float(np.linalg.norm(np.median(position_m[-10:], axis=0) - settled_m))
    return (since, crept_m) if e.duration_s - since >= STILL_S and crept_m < FAR_M else None


def last_shown_s(e: Evidence, holds: np.ndarray) -> float:
    """When so many reports in a row have shown something for the last time, so that no jump of the tracker counts; 0 if never."""
    runs = np.convolve(holds, np.ones(IN_A_ROW), "valid") == IN_A_ROW if len(holds) >= IN_A_ROW else np.zeros(0, bool)
    ends = np.flatnonzero(runs) + IN_A_ROW - 1
    return float(e.seen.t_s[ends[-1]]) if len(ends) else 0.0


def ended_m(e: Evidence) -> float:
    """How far from its goal the object ended."""
    return float(goal_error_m(e)[-1]) if e.judged_error_m is None else e.judged_error_m
