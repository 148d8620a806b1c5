"""Why a trial failed, in one sentence: a pure function of what a robot measures, so that a log alone is enough.

The rules stand in their order: what explains most comes first, and the last one always holds. Nothing here knows the true pose of
the object; only the judged error at the end, which everybody may see, does.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from trial_logs.measured import (
    HEIGHT_M,
    JUST_M,
    NEAR_END_S,
    STILL_M,
    WAVERED,
    Evidence,
    calm_since,
    ended_m,
    gaps_m,
    goal_error_m,
    has_passed,
    highest_m,
    is_up,
    last_gap_m,
    last_shown_s,
    least_turned_rad,
    moves_at_end,
    put_at_goal,
    reach_m,
    seen_goal_error_m,
    slips_of,
    stays_s,
    turned_rad,
    visits_of,
)
from trial_logs.moments import way_of_object

BLIND_S = 2.0
"""So long without a report of the tracker is lost."""
BLIND_SHARE = 0.3
MAY_TOUCH_M = 0.012
"""So near to the object, by a tracker with errors of millimetres, a fingertip may touch it: nobody says that none has."""
TOUCHES_M = 0.005
"""So near it is said to touch it."""
MOVED_M = 0.010
WALL_M = 0.012
"""As near as this to the wall with its corner or face, the object stands at it."""
JOLTS_M = 0.016
"""By so much from one second to the next it may be pushed along the wall."""
COMING_M_S = 0.004
"""An object that nears its goal faster than this in the last seconds is on its way."""
COMING_M = 0.006
"""And has come nearer by so much in these seconds."""
SATURATED, SATURATED_SHARE = 0.98, 0.5
"""Share of the limit, and of the time, that a joint works at."""
REVERSALS_HZ, REVERSALS_RAD_S = 8.0, 1.0
"""A joint that turns about so often, at such speeds, thrashes."""
ALREADY_S = 0.4
"""What slips later than this before a fall is noticed slips because the object falls."""
FALLS_S = 0.15
"""So long before a fall is noticed the object was still up."""
BEGAN_S = 0.2
NEVER_UP_M = 0.006
STAYS_M, STAYS_S = 0.010, 5.0
"""A distance that changes by no more than this, for so long, is one at which the object stays."""


@dataclass(frozen=True)
class Why:
    """Kind, sentence, and when and with which finger, where that is known; a finger is told by its name."""

    kind: str
    sentence: str
    at_s: float | None = None
    finger: str | None = None


def why_failed(evidence: Evidence) -> Why:
    """The sentence for a trial that ran to its end and did not succeed."""
    rules = OF_FINGERS if evidence.goal_m is None else OF_OBJECTS
    return next(why for rule in rules if (why := rule(evidence)) is not None)


def _tracker_lost(e: Evidence) -> Why | None:
    times = np.concatenate([[0.0], e.seen.t_s, [e.duration_s]])
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
    nearest_m = gaps_m(e).min()
    moved_m = np.linalg.norm(e.seen.pose[:, :3] - e.seen.pose[0, :3], axis=1).max()
    if nearest_m < MAY_TOUCH_M or moved_m > MOVED_M:
        return None
    return Why("untouched", f"no finger came nearer to the object than {1e3 * nearest_m:.0f} mm; it never moved")


def _dropped(e: Evidence) -> Why | None:
    way = way_of_object(e.seen.t_s, e.seen.pose, None, 0.0)
    falls = [moment for moment in way if moment.text == "dropped" and not put_at_goal(e, moment.t_s)]
    if not falls or is_up(e):
        return None
    fall = falls[-1]
    before = e.seen.pose[e.seen.t_s < fall.t_s - FALLS_S, 2]
    rest = float(np.median(e.seen.pose[:5, 2]))
    from_m = float(np.median(before[-5:]) - rest) if len(before) else 0.0
    slips = [each for each in slips_of(e) if fall.t_s - 1.5 <= each.t_s <= fall.t_s - ALREADY_S]
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
    highest = highest_m(e)
    if highest > max(0.5 * (float(e.goal_m[2]) - rest), HEIGHT_M):
        return None
    wanted = f"{1e3 * (float(e.goal_m[2]) - rest):.0f} mm were wanted"
    if highest < NEVER_UP_M:
        return Why("not_lifted", f"the object was never lifted, {wanted}: {_ended(e)}")
    slips = slips_of(e)
    slipped = f"; {slips[0].text} at {slips[0].t_s:.1f} s" if slips else ""
    return Why("not_lifted", f"the object was lifted {1e3 * highest:.0f} mm at most, {wanted}{slipped}: {_ended(e)}")


def _wrong_angle(e: Evidence) -> Why | None:
    if e.goal_quat_wxyz is None or ended_m(e) >= e.within_m:
        return None
    angle = turned_rad(e)
    if angle < e.within_rad:
        return None
    return Why("wrong_angle", f"the object is at its place, but turned by {np.rad2deg(angle):.0f}° from its goal")


def _always_turned(e: Evidence) -> Why | None:
    """At its place for long, and never as it should be turned."""
    visits = visits_of(e)
    if not visits or has_passed(e, visits) or (angle := least_turned_rad(e, visits)) <= e.within_rad:
        return None
    came = f"{_came(visits[0][0], 'its place')}, {_within(e, visits)}, but turned by {np.rad2deg(angle):.0f}° at least"
    return Why("wrong_angle", f"the object {came}: {_ended(e)}")


def _left(e: Evidence) -> Why | None:
    visits = visits_of(e)
    if not visits or has_passed(e, visits):
        return None
    (first, _), (_, last) = visits[0], visits[-1]
    within = _within(e, visits)
    if last is None:
        how = "left it at the last moment" if moves_at_end(e) else "ended just outside of it"
        is_told = e.within_m <= ended_m(e) and (moves_at_end(e) or ended_m(e) < e.within_m + JUST_M)
        stayed = f", {within}," if len(visits) > 1 else ""
        return Why("left", f"the object {_came(first)}{stayed} and {how}: {_ended(e)}") if is_told else None
    came = _came(first)
    slips = [each for each in slips_of(e) if last - 1.5 <= each.t_s <= last + 0.2] if is_up(e, last) else []
    slipped = f" as {slips[-1].text}" if slips else ""
    if len(visits) >= WAVERED:
        told = f"the object {came} and wavered about its edge, {within} and for the last time at {last:.1f} s{slipped}"
    elif len(visits) > 1:
        told = f"the object {came} and left it at {last:.1f} s for the last time, {within}{slipped}"
    else:
        told = f"the object {came} and left it at {last:.1f} s{slipped}"
    return Why("left", f"{told}: {_ended(e)}", last)


def _misjudged(e: Evidence) -> Why | None:
    """At the goal by the tracker, and not by the judges."""
    seen_m = float(np.median(seen_goal_error_m(e)[-5:]))
    if e.judged_error_m is None or seen_m >= e.within_m or e.judged_error_m < e.within_m or moves_at_end(e):
        return None
    apart = f"the tracker had the object {1e3 * seen_m:.0f} mm from its goal, the judges {1e3 * e.judged_error_m:.0f} mm"
    return Why("tracker_off", apart)


def _at_wall(e: Evidence) -> Why | None:
    at_wall = reach_m(e) >= e.wall_m - WALL_M
    if not at_wall[-1] or (calm := calm_since(e, JOLTS_M)) is None:
        return None
    since, crept_m = calm
    if not at_wall[e.seen.t_s >= since][0]:
        return None
    crept = f" and crept {1e3 * crept_m:.0f} mm along it" if crept_m > STILL_M else ""
    return Why("at_wall", f"the object {_passed(e, since)}stands at the wall since {since:.1f} s{crept}: {_ended(e)}", since)


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
    strained = np.flatnonzero(share >= SATURATED_SHARE).tolist()
    if not strained:
        return None
    gap_m = 0.0 if e.goal_m is None else last_gap_m(e)
    touching = [] if e.goal_m is None else sorted(_at_object(e).intersection(strained))
    worst = max(touching or strained, key=lambda joint: share[joint])
    touch = "" if gap_m < MAY_TOUCH_M else f", and the nearest finger is {1e3 * gap_m:.0f} mm away from the object"
    before = _passed(e).removesuffix(" and ") if e.goal_m is not None else ""
    others = f" and {len(strained) - 1} more" if len(strained) > 1 else ""
    worked = f"{_joint(e, worst)}{others} worked at {'their' if others else 'its'} torque limit for "
    least, most = (f"{100 * each:.0f}" for each in (share[strained].min(), share[strained].max()))
    worked += f"{most if least == most else f'{least} to {most}'} % of the time{touch}"
    return Why("saturated", f"{f'the object {before}; ' if before else ''}{worked}: {_ended(e)}")


def _at_object(e: Evidence) -> frozenset[int]:
    """The joints, which lie finger by finger, of those that touch the object most of the time."""
    each = len(e.joints) // len(e.seen.fingers)
    fingers = np.flatnonzero(np.median(gaps_m(e), axis=0) < MAY_TOUCH_M).tolist()
    return frozenset(finger * each + joint for finger in fingers for joint in range(each))


def _slipped(e: Evidence) -> Why | None:
    assert e.goal_m is not None, "objects have goals"
    if e.goal_m[2] - float(np.median(e.seen.pose[:5, 2])) < HEIGHT_M or not (slips := slips_of(e)):
        return None
    slip = slips[-1]
    if any(moment.text == "lifted" and moment.t_s > slip.t_s for moment in way_of_object(e.seen.t_s, e.seen.pose, None, 0.0)):
        return None
    finger = next((name for name in e.seen.fingers if slip.text.startswith(name)), None)
    return Why("slipped", f"{slip.text} at {slip.t_s:.1f} s: {_ended(e)}", slip.t_s, finger)


def _late(e: Evidence) -> Why | None:
    error_m, t_s = goal_error_m(e), e.seen.t_s
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
    calm = calm_since(e)
    if calm is None:
        return None
    since, crept_m = calm
    is_near = gaps_m(e)[e.seen.t_s >= since].min(axis=1) < MAY_TOUCH_M
    is_still = crept_m <= STILL_M or not is_near.any()  # what nobody touches does not creep: the tracker wanders
    if is_up(e):
        return Why("held_off", f"the object is held{' still' * is_still} in the air since {since:.1f} s: {_ended(e)}", since)
    how = f"lies still since {since:.1f} s" if is_still else f"creeps since {since:.1f} s, by {1e3 * crept_m:.0f} mm"
    return Why("still", f"the object {_passed(e, since)}{how}, {_touch(e)}: {_ended(e)}", since)


def _missed(e: Evidence) -> Why | None:
    error_m = goal_error_m(e)
    since = last_shown_s(e, np.abs(error_m - np.median(error_m[-10:])) > STAYS_M)
    if e.duration_s - since >= STAYS_S:
        low, high = 1e3 * np.quantile(error_m[e.seen.t_s > since], (0.03, 0.97))
        low, high = min(low, 1e3 * ended_m(e)), max(high, 1e3 * ended_m(e))
        stays = f"stays {low:.0f} to {high:.0f} mm from its goal since {since:.1f} s, {_touch(e)}"
        return Why("missed", f"the object {_passed(e, since)}{stays}: {_ended(e)}", since)
    nearest = int(error_m.argmin())
    came = f"came to {1e3 * error_m[nearest]:.0f} mm from its goal at {e.seen.t_s[nearest]:.1f} s"
    return Why("missed", f"the object {_passed(e).removesuffix(' and ') or came}: {_ended(e)}")


def _finger_off(e: Evidence) -> Why | None:
    assert e.tips_away_m is not None, "fingertips have goals"
    worst = int(e.tips_away_m[-1].argmax())
    nearest_m, name = float(e.tips_away_m[:, worst].min()), e.seen.fingers[worst]
    told = f"{name} ended {1e3 * e.tips_away_m[-1, worst]:.0f} mm from its place, {1e3 * nearest_m:.0f} mm at its nearest"
    return Why("finger_off", told, None, name)


Rule = Callable[[Evidence], Why | None]
OF_OBJECTS: tuple[Rule, ...] = (
    _tracker_lost,
    _untouched,
    _wrong_angle,
    _dropped,
    _not_lifted,
    _misjudged,
    _always_turned,
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


def _within(e: Evidence, visits: Sequence[tuple[float, float | None]]) -> str:
    return f"within {1e3 * e.within_m:.0f} mm for {sum(stays_s(e, visits)):.1f} s in all"


def _came(at_s: float, where: str = "its goal") -> str:
    return f"began at {where}" if at_s < BEGAN_S else f"reached {where} at {at_s:.1f} s"


def _passed(e: Evidence, until_s: float = np.inf) -> str:
    """What comes before the end of an object that was at its goal for moments only, the last of them before a time."""
    visits = visits_of(e)
    return f"passed its goal at {visits[-1][0]:.1f} s and " if has_passed(e, visits) and visits[-1][0] < until_s else ""


def _touch(e: Evidence) -> str:
    gap_m = last_gap_m(e)
    return "though a finger touches it" if gap_m < TOUCHES_M else f"and the nearest finger is {1e3 * gap_m:.0f} mm away"


def _joint(e: Evidence, index: int) -> str:
    return f"joint {e.joints[index]}"


def _ended(e: Evidence) -> str:
    if e.goal_m is None:
        assert e.tips_away_m is not None, "fingertips have goals"
        return f"the worst finger ended {1e3 * e.tips_away_m[-1].max():.0f} mm from its place"
    turned = "" if e.goal_quat_wxyz is None else f" and {np.rad2deg(turned_rad(e)):.0f}°"
    return f"{1e3 * ended_m(e):.0f} mm{turned} from its goal at the end"
