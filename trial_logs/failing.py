"""Why a trial failed, in one sentence: a pure function of what a robot measures, so that a log alone is enough.

The rules stand in their order: what explains most comes first, and the last one always holds. Nothing here knows the true pose of
the object; only the judged error at the end, which everybody may see, does.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from trial_logs.moments import Moment, Seen, holds_of_fingers, in_object, smoothed, surface_distance, turns, way_of_object

BLIND_S = 2.0
"""So long without a report of the tracker is lost."""
BLIND_SHARE = 0.3
SURE = 0.75
"""Below this the tracker repeats the pose before (its own threshold)."""
TOUCHED_M = 0.012
MOVED_M = 0.010
STILL_M, STILL_S = 0.006, 3.0
WALL_M = 0.012
"""As near as this to the wall with its corner or face, the object stands at it."""
NEAR_END_S = 1.0
COMING_M_S = 0.004
"""An object that nears its goal faster than this in the last seconds is on its way."""
SATURATED, SATURATED_SHARE = 0.98, 0.5
"""Share of the limit, and of the time, that a joint works at."""
REVERSALS_HZ, REVERSALS_RAD_S = 8.0, 1.0
"""A joint that turns about so often, at such speeds, thrashes."""
COMING_M = 0.006
"""And has come nearer by so much within them."""
IN_A_ROW = 4
"""So many reports of the tracker are believed."""
HEIGHT_M = 0.015
BEGAN_S = 0.2
PASSED_S = 1.0
"""An object that was at its goal for less than this in all has passed it; what came then is told."""
WAVERED = 3
"""Who comes to the goal so often wavers about its edge."""
STAYS_M, STAYS_S = 0.010, 5.0
"""A distance that changes by no more than this, for so long, is one at which the object stays."""


@dataclass(frozen=True)
class Why:
    """Kind, sentence, and when and with which finger, where that is known; a finger is told by its name."""

    kind: str
    sentence: str
    at_s: float | None = None
    finger: str | None = None


@dataclass(frozen=True)
class Evidence:
    """What was measured of a trial, and what was asked.

    Args:
        seen: the object by the tracker's reports, at the times of their frames, with the fingertips then.
        confidence: of these reports, shape (n,).
        duration_s: of the trial as it ran.
        goal_m: wanted position of the object, shape (3,); None where fingertips have goals.
        goal_quat_wxyz: shape (4,), where the orientation counts, else None.
        goal_tips_m: wanted fingertips, shape (fingers, 3), or None.
        state_t_s: times of what follows, shape (m,).
        velocity_rad_s: of the joints, shape (m, joints).
        applied_nm: torques, shape (m, joints).
        tips_m: fingertips, shape (m, fingers, 3).
        joints: their names.
        max_torque_nm: the limit of the joints.
        wall_m: inner radius of the arena.
        within_m: how near to its goal the object must end.
        within_rad: the same of its orientation.
        judged_error_m: position error at the end by the judges, None if they had none.
    """

    seen: Seen
    confidence: np.ndarray
    duration_s: float
    goal_m: np.ndarray | None
    goal_quat_wxyz: np.ndarray | None
    goal_tips_m: np.ndarray | None
    state_t_s: np.ndarray
    velocity_rad_s: np.ndarray
    applied_nm: np.ndarray
    tips_m: np.ndarray
    joints: Sequence[str]
    max_torque_nm: float
    wall_m: float
    within_m: float
    within_rad: float
    judged_error_m: float | None


def why_failed(evidence: Evidence) -> Why:
    """The sentence for a trial that ran to its end and did not succeed."""
    rules = OF_FINGERS if evidence.goal_m is None else OF_OBJECTS
    return next(why for rule in rules if (why := rule(evidence)) is not None)


def _tracker_lost(e: Evidence) -> Why | None:
    sure = e.seen.t_s[e.confidence >= SURE]
    times = np.concatenate([[0.0], sure, [e.duration_s]])
    gaps = np.diff(times)
    longest = int(gaps.argmax())
    blind_s = float(gaps[gaps > BLIND_S].sum())
    is_lost = blind_s > BLIND_SHARE * e.duration_s or (gaps[longest] > BLIND_S and times[longest + 1] > e.duration_s - NEAR_END_S)
    if not is_lost:
        return None
    since = float(times[longest])
    return Why("tracker_lost", f"the tracker did not see the object for {gaps[longest]:.1f} s, from {since:.1f} s on", since)


def _untouched(e: Evidence) -> Why | None:
    if len(e.seen.t_s) < 3:
        return Why("tracker_lost", "the tracker hardly saw the object")
    nearest_m = _gaps_m(e).min()
    moved_m = np.linalg.norm(e.seen.pose[:, :3] - e.seen.pose[0, :3], axis=1).max()
    if nearest_m < TOUCHED_M or moved_m > MOVED_M:
        return None
    return Why("untouched", f"no finger came nearer to the object than {1e3 * nearest_m:.0f} mm; it never moved")


def _dropped(e: Evidence) -> Why | None:
    way = way_of_object(e.seen.t_s, e.seen.pose, None, 0.0)
    falls = [moment for moment in way if moment.text == "dropped" and not _put_at_goal(e, moment.t_s)]
    if not falls or _is_up(e):
        return None
    fall = falls[-1]
    before = e.seen.pose[e.seen.t_s < fall.t_s - 0.05, 2]
    rest = float(np.median(e.seen.pose[:5, 2]))
    from_m = float(before[-5:].max() - rest) if len(before) else 0.0
    slips = [each for each in _slips(e) if fall.t_s - 1.5 <= each.t_s <= fall.t_s]
    how = f"{slips[-1].text} at {slips[-1].t_s:.1f} s, and the object was dropped" if slips else "the object was dropped"
    times = f", {len(falls)} times in all" if len(falls) > 1 else ""
    sentence = f"{how} at {fall.t_s:.1f} s from {1e3 * from_m:.0f} mm up{times}: {_ended(e)}"
    finger = next((name for name in e.seen.fingers if slips and slips[-1].text.startswith(name)), None)
    return Why("dropped", sentence, fall.t_s, finger)


def _not_lifted(e: Evidence) -> Why | None:
    assert e.goal_m is not None, "objects have goals"
    rest = float(np.median(e.seen.pose[:5, 2]))
    if e.goal_m[2] - rest < HEIGHT_M:
        return None
    highest = float(np.median(np.sort(e.seen.pose[:, 2])[-3:]) - rest)
    if highest > max(0.5 * (float(e.goal_m[2]) - rest), HEIGHT_M):
        return None
    slips = _slips(e)
    slipped = f"; {slips[0].text} at {slips[0].t_s:.1f} s" if slips else ""
    wanted = 1e3 * (float(e.goal_m[2]) - rest)
    told = f"the object was lifted {max(0.0, 1e3 * highest):.0f} mm at most, {wanted:.0f} mm were wanted{slipped}"
    return Why("not_lifted", told)


def _wrong_angle(e: Evidence) -> Why | None:
    away_m = float(_error_m(e)[-1]) if e.judged_error_m is None else e.judged_error_m
    if e.goal_quat_wxyz is None or away_m >= e.within_m:
        return None
    angle = float(_angles(e)[-3:].mean())
    if angle < e.within_rad:
        return None
    return Why("wrong_angle", f"the object is at its place, but turned by {np.rad2deg(angle):.0f}° from its goal")


def _left(e: Evidence) -> Why | None:
    visits = _visits(e)
    if not visits or visits[-1][1] is None or _has_passed(e, visits):
        return None
    first, last = visits[0][0], visits[-1][1]
    slips = [each for each in _slips(e) if last - 1.5 <= each.t_s <= last + 0.2] if _is_up(e, last) else []
    slipped = f" as {slips[-1].text}" if slips else ""
    came = "began at its goal" if first < BEGAN_S else f"reached its goal at {first:.1f} s"
    within = f"within {1e3 * e.within_m:.0f} mm for {sum(_stays_s(e, visits)):.1f} s in all"
    if len(visits) >= WAVERED:
        told = f"the object {came} and wavered about its edge, {within} and for the last time at {last:.1f} s{slipped}"
    elif len(visits) > 1:
        told = f"the object {came} and left it at {last:.1f} s for the last time, {within}{slipped}"
    else:
        told = f"the object {came} and left it at {last:.1f} s{slipped}"
    return Why("left", f"{told}: {_ended(e)}", last)


def _misjudged(e: Evidence) -> Why | None:
    """At the goal by the tracker, and not by the judges."""
    seen_m = float(np.median(_error_m(e)[-5:]))
    if e.judged_error_m is None or seen_m >= e.within_m or e.judged_error_m < e.within_m:
        return None
    apart = f"the tracker had the object {1e3 * seen_m:.0f} mm from its goal, the judges {1e3 * e.judged_error_m:.0f} mm"
    return Why("tracker_off", apart)


def _at_wall(e: Evidence) -> Why | None:
    since = _still_since(e)
    reach_m = float((np.linalg.norm(_corners(e), axis=1)).max())
    if since is None or reach_m < e.wall_m - WALL_M:
        return None
    return Why("at_wall", f"the object {_passed(e)}stands at the wall since {since:.1f} s: {_ended(e)}", since)


def _thrashing(e: Evidence) -> Why | None:
    fast = np.abs(e.velocity_rad_s) > REVERSALS_RAD_S / 2
    turned = (np.diff(np.sign(e.velocity_rad_s), axis=0) != 0) & fast[1:]
    rate_hz = turned.sum(axis=0) / max(e.duration_s, 1e-9)
    worst = int(rate_hz.argmax())
    if rate_hz[worst] < REVERSALS_HZ:
        return None
    return Why("thrashing", f"{_joint(e, worst)} turned about {rate_hz[worst]:.0f} times a second: {_ended(e)}")


def _saturated(e: Evidence) -> Why | None:
    share = (np.abs(e.applied_nm) > SATURATED * e.max_torque_nm).mean(axis=0)
    worst = int(share.argmax())
    if share[worst] < SATURATED_SHARE:
        return None
    gap_m = 0.0 if e.goal_m is None else _last_gap_m(e)
    touch = "" if gap_m < TOUCHED_M else f", and the nearest finger is {1e3 * gap_m:.0f} mm away from the object"
    before = _passed(e).removesuffix(" and ") if e.goal_m is not None else ""
    worked = f"{_joint(e, worst)} worked at its torque limit for {100 * share[worst]:.0f} % of the time{touch}"
    return Why("saturated", f"{f'the object {before}; ' if before else ''}{worked}: {_ended(e)}")


def _slipped(e: Evidence) -> Why | None:
    slips = _slips(e)
    assert e.goal_m is not None, "objects have goals"
    if not slips or e.goal_m[2] - float(np.median(e.seen.pose[:5, 2])) < HEIGHT_M:
        return None
    slip = slips[-1]
    if any(moment.text == "lifted" and moment.t_s > slip.t_s for moment in way_of_object(e.seen.t_s, e.seen.pose, None, 0.0)):
        return None
    finger = next((name for name in e.seen.fingers if slip.text.startswith(name)), None)
    return Why("slipped", f"{slip.text} at {slip.t_s:.1f} s: {_ended(e)}", slip.t_s, finger)


def _late(e: Evidence) -> Why | None:
    error_m, t_s = _error_m(e), e.seen.t_s
    last = t_s > e.duration_s - 2 * NEAR_END_S
    if last.sum() < 5:
        return None
    slope = float(np.polyfit(t_s[last], error_m[last], 1)[0])
    quarter = max(int(last.sum()) // 4, 1)
    nearer_m = float(np.median(error_m[last][:quarter]) - np.median(error_m[-quarter:]))
    if -slope < COMING_M_S or nearer_m < COMING_M:
        return None
    return Why("late", f"the object was on its way to the goal, {-1e3 * slope:.0f} mm/s, when time was over: {_ended(e)}")


def _still(e: Evidence) -> Why | None:
    since = _still_since(e)
    if since is None or since > e.duration_s - STILL_S:
        return None
    if _is_up(e):
        return Why("held_off", f"the object is held still in the air since {since:.1f} s: {_ended(e)}", since)
    return Why("still", f"the object {_passed(e)}lies still since {since:.1f} s, {_touch(e)}: {_ended(e)}", since)


def _missed(e: Evidence) -> Why | None:
    error_m = _error_m(e)
    since = _last_s(e, np.abs(error_m - np.median(error_m[-10:])) > STAYS_M)
    if e.duration_s - since >= STAYS_S:
        low, high = 1e3 * np.quantile(error_m[e.seen.t_s > since], (0.1, 0.9))
        stays = f"stays {low:.0f} to {high:.0f} mm from its goal since {since:.1f} s, {_touch(e)}"
        return Why("missed", f"the object {_passed(e)}{stays}: {_ended(e)}", since)
    nearest = int(error_m.argmin())
    came = f"came to {1e3 * error_m[nearest]:.0f} mm from its goal at {e.seen.t_s[nearest]:.1f} s"
    return Why("missed", f"the object {_passed(e).removesuffix(' and ') or came}: {_ended(e)}")


def _finger_off(e: Evidence) -> Why | None:
    assert e.goal_tips_m is not None, "fingertips have goals"
    away_m = np.linalg.norm(e.tips_m - e.goal_tips_m, axis=2)
    worst = int(away_m[-1].argmax())
    nearest_m, name = float(away_m[:, worst].min()), e.seen.fingers[worst]
    told = f"{name} ended {1e3 * away_m[-1, worst]:.0f} mm from its place, {1e3 * nearest_m:.0f} mm at its nearest"
    return Why("finger_off", told, None, name)


Rule = Callable[[Evidence], Why | None]
OF_OBJECTS: tuple[Rule, ...] = (
    _tracker_lost,
    _untouched,
    _wrong_angle,
    _dropped,
    _not_lifted,
    _misjudged,
    _left,
    _at_wall,
    _slipped,
    _thrashing,
    _saturated,
    _late,
    _still,
    _missed,
)
OF_FINGERS: tuple[Rule, ...] = (_thrashing, _saturated, _finger_off)


def _is_up(e: Evidence, t_s: float | None = None) -> bool:
    """Whether the object is in the air at a time, or at the end."""
    height_m, last = e.seen.pose[:, 2], len(e.seen.t_s) if t_s is None else max(int(np.searchsorted(e.seen.t_s, t_s)), 1)
    return float(np.median(height_m[max(0, last - 5) : last]) - np.median(height_m[:5])) > HEIGHT_M


def _visits(e: Evidence) -> list[tuple[float, float | None]]:
    """From when until when the object was at its goal by the tracker; None where it still is."""
    visits: list[tuple[float, float | None]] = []
    for moment in way_of_object(e.seen.t_s, smoothed(e.seen.pose), e.goal_m, e.within_m):
        if moment.text == "at the goal":
            visits.append((moment.t_s, None))
        elif moment.text == "left the goal":
            visits[-1] = (visits[-1][0], moment.t_s)
    return visits


def _stays_s(e: Evidence, visits: Sequence[tuple[float, float | None]]) -> list[float]:
    """How long each visit was."""
    return [(e.duration_s if until is None else until) - since for since, until in visits]


def _has_passed(e: Evidence, visits: Sequence[tuple[float, float | None]]) -> bool:
    """Whether all visits were too short, and too few, to say that the object was at its goal."""
    return len(visits) < WAVERED and max(_stays_s(e, visits)) < PASSED_S


def _passed(e: Evidence) -> str:
    """What comes before the end of an object that was at its goal for moments only."""
    visits = _visits(e)
    return f"passed its goal at {visits[-1][0]:.1f} s and " if visits and _has_passed(e, visits) else ""


def _touch(e: Evidence) -> str:
    gap_m = _last_gap_m(e)
    return "though a finger touches it" if gap_m < TOUCHED_M else f"and the nearest finger is {1e3 * gap_m:.0f} mm away"


def _last_gap_m(e: Evidence) -> float:
    """Of the nearest finger at the end."""
    return float(np.median(_gaps_m(e)[-10:], axis=0).min())


def _put_at_goal(e: Evidence, t_s: float) -> bool:
    """Whether an object whose goal is on the table came down at it: then it was put there, however fast."""
    assert e.goal_m is not None, "objects have goals"
    on_table = e.goal_m[2] - float(np.median(e.seen.pose[:5, 2])) < HEIGHT_M
    landed = np.flatnonzero(e.seen.t_s >= t_s)[:5]
    away_m = np.linalg.norm(e.seen.pose[landed, :2] - e.goal_m[:2], axis=1)
    return on_table and len(landed) > 0 and float(np.median(away_m)) < e.within_m


def _slips(e: Evidence) -> list[Moment]:
    return [moment for moment in holds_of_fingers(e.seen) if "slipped" in moment.text]


def _error_m(e: Evidence) -> np.ndarray:
    """Distance of the object from its goal by the tracker, the middle one of five reports, shape (n,)."""
    error_m = np.linalg.norm(e.seen.pose[:, :3] - e.goal_m, axis=1)
    padded = np.pad(error_m, 2, mode="edge")
    return np.median([padded[at : at + len(error_m)] for at in range(5)], axis=0)


def _angles(e: Evidence) -> np.ndarray:
    assert e.goal_quat_wxyz is not None, "the orientation counts"
    return 2 * np.arccos(np.clip(np.abs(e.seen.pose[:, 3:] @ e.goal_quat_wxyz), 0.0, 1.0))


def _gaps_m(e: Evidence) -> np.ndarray:
    """From each fingertip to the object's surface, shape (n, fingers)."""
    places = in_object(e.seen.tips_m, e.seen.pose)
    return surface_distance(places, e.seen.half_m, is_ball=e.seen.is_ball) - e.seen.tip_radius_m


def _corners(e: Evidence) -> np.ndarray:
    """The object's corners at the end in the plane of the table, shape (8, 2)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    pose = e.seen.pose[-1:]
    turn = turns(pose[:, 3:])[0, :2]
    return pose[0, :2] + (signs * e.seen.half_m) @ turn.T


def _still_since(e: Evidence) -> float | None:
    """Since when the object has not moved, if for ``STILL_S`` at least."""
    position_m = smoothed(e.seen.pose)[:, :3]
    away_m = np.linalg.norm(position_m - np.median(position_m[-5:], axis=0), axis=1)
    since = _last_s(e, away_m > STILL_M)
    return since if e.duration_s - since >= STILL_S else None


def _last_s(e: Evidence, holds: np.ndarray) -> float:
    """When so many reports in a row have shown something for the last time, so that no jump of the tracker counts; 0 if never."""
    runs = np.convolve(holds, np.ones(IN_A_ROW), "valid") == IN_A_ROW if len(holds) >= IN_A_ROW else np.zeros(0, bool)
    ends = np.flatnonzero(runs) + IN_A_ROW - 1
    return float(e.seen.t_s[ends[-1]]) if len(ends) else 0.0


def _joint(e: Evidence, index: int) -> str:
    return f"joint {e.joints[index]}"


def _ended(e: Evidence) -> str:
    if e.goal_m is None:
        assert e.goal_tips_m is not None, "fingertips have goals"
        return f"the worst finger ended {1e3 * np.linalg.norm(e.tips_m[-1] - e.goal_tips_m, axis=1).max():.0f} mm from its place"
    error_m = float(_error_m(e)[-1]) if e.judged_error_m is None else e.judged_error_m
    turned = "" if e.goal_quat_wxyz is None else f" and {np.rad2deg(float(_angles(e)[-3:].mean())):.0f}°"
    return f"{1e3 * error_m:.0f} mm{turned} from its goal at the end"
