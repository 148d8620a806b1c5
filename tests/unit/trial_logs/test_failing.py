"""Made-up trials, each with one thing wrong: the sentence names it."""

from dataclasses import replace

import numpy as np
import pytest

from trial_logs.failing import OF_OBJECTS, Evidence, why_failed
from trial_logs.moments import Seen

FINGERS = ("finger 0", "finger 120", "finger 240")
JOINTS = tuple(f"joint{number}" for number in range(9))
T_S, STATE_S = np.arange(0.0, 15.0, 0.1), np.arange(0.0, 15.0, 0.01)
REST_M, HALF_M, TIP_M = 0.0325, 0.0325, 0.01
GOAL = np.array([0.1, 0.0, REST_M])
NEAR = np.array([HALF_M + TIP_M, 0.0, 0.0])


def line(*points):
    """A way through (time, x, y, z), straight between."""
    points = np.array(points, dtype=float)
    return np.stack([np.interp(T_S, points[:, 0], points[:, axis]) for axis in (1, 2, 3)], axis=1)


def trial(way, *, tips=None, turned_rad=0.0, goal=GOAL, confidence=None, judged_m=None, **more):
    turn = np.array([np.cos(turned_rad / 2), 0.0, 0.0, np.sin(turned_rad / 2)])
    pose = np.concatenate([way, np.tile(turn, (len(way), 1))], axis=1)
    tips_m = np.repeat((way + NEAR)[:, None], 3, axis=1) if tips is None else tips
    seen = Seen(T_S[: len(way)], pose, tips_m, np.full(3, HALF_M), False, TIP_M, FINGERS)
    evidence = Evidence(
        seen=seen,
        confidence=np.ones(len(way)) if confidence is None else confidence,
        duration_s=15.0,
        goal_m=goal,
        goal_quat_wxyz=None,
        goal_tips_m=None,
        state_t_s=STATE_S,
        velocity_rad_s=np.zeros((len(STATE_S), 9)),
        applied_nm=np.zeros((len(STATE_S), 9)),
        tips_m=np.zeros((len(STATE_S), 3, 3)),
        joints=JOINTS,
        max_torque_nm=0.4,
        wall_m=0.195,
        within_m=0.02,
        within_rad=0.38,
        judged_error_m=judged_m,
    )
    return replace(evidence, **more)


AT_START = (0, 0.0, 0.0, REST_M)
STAYS = line(AT_START, (15, 0.0, 0.0, REST_M))
FAR = np.full((len(T_S), 3, 3), 0.2)
MOVES = line(AT_START, (2, 0.04, 0, REST_M), (15, 0.04, 0.02, REST_M))
UP = np.array([0.0, 0.0, 0.0825])


def blind(since_s, until_s):
    return np.where(np.abs(T_S - (since_s + until_s) / 2) < (until_s - since_s) / 2, 0.2, 1.0)


def fast(rate_hz):
    velocity = np.zeros((len(STATE_S), 9))
    velocity[:, 4] = 3 * np.sign(np.sin(np.pi * rate_hz * STATE_S + 0.1))
    return velocity


def strained():
    applied = np.zeros((len(STATE_S), 9))
    applied[300:, 7] = -0.4
    return applied


CASES = {
    "tracker_lost": (trial(MOVES, confidence=blind(6, 14.5)), "did not see the object for 8"),
    "untouched": (trial(STAYS, tips=FAR), "never moved"),
    "dropped": (
        trial(line(AT_START, (3, 0, 0, REST_M), (5, 0, 0, 0.09), (8, 0, 0, 0.09), (8.3, 0, 0, REST_M)), goal=UP),
        "dropped at 8.",
    ),
    "not_lifted": (trial(MOVES, goal=UP), "lifted 0 mm at most, 50 mm were wanted"),
    "wrong_angle": (
        trial(line(AT_START, (5, *GOAL)), turned_rad=1.0, goal_quat_wxyz=np.array([1.0, 0, 0, 0])),
        "turned by 57° from its goal",
    ),
    "tracker_off": (trial(line(AT_START, (5, *GOAL)), judged_m=0.031), "0 mm from its goal, the judges 31 mm"),
    "left": (trial(line(AT_START, (4, *GOAL), (8, *GOAL), (10, 0.04, 0, REST_M))), "and left it at 8."),
    "at_wall": (trial(line(AT_START, (5, 0, 0.155, REST_M))), "stands at the wall since 4."),
    "thrashing": (trial(MOVES, velocity_rad_s=fast(12)), "joint joint4 turned about 12 times a second"),
    "saturated": (trial(MOVES, applied_nm=strained()), "joint joint7 worked at its torque limit for 80 %"),
    "late": (trial(line(AT_START, (10, 0, 0, REST_M), (15, 0.07, 0, REST_M))), "on its way to the goal, 14 mm/s"),
    "still": (trial(line(AT_START, (5, 0.05, 0, REST_M))), "lies still since 4."),
    "missed": (trial(line(AT_START, (12, 0.07, 0, REST_M), (15, 0.05, 0, REST_M))), "came to 31 mm from its goal at 11.9 s"),
}


FALLS = line(AT_START, (3, 0, 0, REST_M), (5, 0.1, 0, 0.09), (8, 0.1, 0, 0.09), (8.3, 0.1, 0, REST_M), (15, 0.1, 0, REST_M))
AGAIN = line(AT_START, (3, 0, 0, 0.08), (3.5, 0, 0, REST_M), (5, 0, 0, REST_M), (6, 0.05, 0, 0.08), (15, 0.05, 0, 0.08))
AS_IT_IS = np.array([1.0, 0, 0, 0])
ENDS = {
    "put on its goal on the table": (trial(FALLS, judged_m=0.03), "tracker_off"),
    "fallen away from its goal on the table": (trial(FALLS, goal=np.array([-0.05, 0, REST_M])), "dropped"),
    "at its place and turned, whatever fell before": (
        trial(FALLS, judged_m=0.005, turned_rad=1.5, goal_quat_wxyz=AS_IT_IS),
        "wrong_angle",
    ),
    "fallen, and held still in the air since": (trial(AGAIN, goal=np.array([0.05, 0.05, 0.0825])), "held_off"),
}


def jumps(way):
    """With one report in between that has the object elsewhere."""
    way = way.copy()
    way[110] += [0.05, 0.0, 0.0]
    return way


OVER = line(AT_START, (1, *GOAL), (1.5, 0.155, 0, REST_M))
WAVERS = line(AT_START, (2, *GOAL), *((2 + k, 0.1 + 0.04 * (k % 2), 0, REST_M) for k in range(1, 12)), (15, 0.14, 0, REST_M))
SLOW = line(AT_START, (3, 0.06, 0, REST_M), (9, 0.07, 0, REST_M), (12, 0.06, 0, REST_M), (15, 0.07, 0, REST_M))
TOLD = {
    "one report that jumps is no motion": (jumps(line(AT_START, (5, 0, 0.155, REST_M))), {}, "at_wall", "at the wall since 4."),
    "what came after a goal passed": (OVER, {}, "at_wall", "passed its goal at 0.8 s and stands at the wall since 1.4 s"),
    "about the edge": (WAVERS, {}, "left", "reached its goal at 1.6 s and wavered about its edge, within 20 mm for 5.4 s"),
    "slow, and never far": (SLOW, {}, "missed", "stays 31 to 39 mm from its goal since 2.9 s, though a finger touches it"),
    "strained, and nowhere near": (MOVES, {"applied_nm": strained(), "tips": FAR}, "saturated", "finger is 228 mm away from the"),
}


@pytest.mark.parametrize("what", TOLD)
def test_what_is_told_of_the_way(what):
    way, more, kind, told = TOLD[what]
    why = why_failed(trial(way, **more))
    assert (why.kind, told in why.sentence) == (kind, True), why.sentence


def test_a_finger_slides_over_what_nobody_holds_up():
    """On the table a slip is no reason for leaving the goal."""
    way = line(AT_START, (4, *GOAL), (8, *GOAL), (10, 0.04, 0, REST_M))
    tips = np.repeat((way + NEAR)[:, None], 3, axis=1)
    tips[75:, 1, 1] += np.linspace(0, 0.03, len(tips[75:])) * 3
    assert "slipped" not in why_failed(trial(way, tips=tips)).sentence


@pytest.mark.parametrize("how", ENDS)
def test_what_counts_is_how_it_ended(how):
    evidence, kind = ENDS[how]
    assert why_failed(evidence).kind == kind


@pytest.mark.parametrize("kind", CASES)
def test_the_sentence_names_what_was_wrong(kind):
    evidence, told = CASES[kind]
    why = why_failed(evidence)
    assert (why.kind, told in why.sentence) == (kind, True), why.sentence


def test_every_rule_but_that_of_slips_is_tried_here():
    assert len(CASES) == len(OF_OBJECTS) - 1  # how slips are found is tried with moments


def test_fingertips_are_told_by_the_one_that_is_farthest():
    tips = np.tile([[0.1, 0, 0.1], [0, 0.1, 0.1], [0.05, 0.05, 0.1]], (len(STATE_S), 1, 1))
    goal = tips[0] + [[0, 0, 0], [0.03, 0, 0], [0, 0, 0.001]]
    why = why_failed(trial(STAYS, goal=None, goal_tips_m=goal, tips_m=tips))
    assert (why.kind, why.finger) == ("finger_off", "finger 120") and "30 mm from its place" in why.sentence
