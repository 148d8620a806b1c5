"""Slips, regrasps and drops that were planted are found, and nothing is found where only the tracker is unsure."""

import numpy as np
import pytest

from trial_logs.moments import Seen, changes, holds_of_fingers, in_object, turns, way_of_object

HALF_M = np.full(3, 0.0325)
RADIUS_M = 0.008
DIRECTIONS = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]])
NOISE_M = 0.001
"""Of each axis of a report of a resting cube, as ``docs/effects.md`` has it for the real tracker, about."""


def held(rng, reports=80, rate_hz=10.0):
    """A cube that is lifted slowly, turned a little and held by three fingertips: times, poses, tips."""
    t_s = np.arange(reports) / rate_hz
    height = 0.0325 + 0.05 * np.clip(t_s - 1.0, 0, 1)
    angle = 0.3 * np.sin(t_s)
    quat = np.stack([np.cos(angle / 2), np.zeros(reports), np.zeros(reports), np.sin(angle / 2)], axis=1)
    true = np.concatenate([0.02 * np.sin(t_s)[:, None], 0.01 * np.cos(t_s)[:, None], height[:, None], quat], axis=1)
    places = np.repeat((DIRECTIONS * (HALF_M + RADIUS_M))[None], reports, axis=0)
    return t_s, true, places, rng


def seen(t_s, true, places, rng):
    """What is measured of it: tips where they are, the object with the tracker's noise."""
    tips = np.einsum("nij,nmj->nmi", turns(true[:, 3:]), places) + true[:, None, :3]
    noisy = true.copy()
    noisy[:, :3] += rng.normal(0, NOISE_M, (len(t_s), 3))
    return Seen(t_s, noisy, tips, HALF_M, False, RADIUS_M, ["finger 0", "finger 120", "finger 240"])


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_found_in_a_hold_that_lasts(seed):
    assert holds_of_fingers(seen(*held(np.random.default_rng(seed)))) == []


def test_one_jump_of_the_tracker_is_no_slip():
    measured = seen(*held(np.random.default_rng(0)))
    measured.pose[40, :3] += 0.05
    measured.pose[60, 3:] = [0.5, 0.5, 0.5, 0.5]
    assert holds_of_fingers(measured) == []


@pytest.mark.parametrize("slide_m", [0.016, 0.03])
def test_a_slip_is_found_when_it_happens_and_by_whom(slide_m):
    t_s, true, places, rng = held(np.random.default_rng(1))
    places[:, 1, 2] += slide_m * np.clip((t_s - 4.0) / 0.2, 0, 1)  # down along the side of the cube
    (found,) = holds_of_fingers(seen(t_s, true, places, rng))
    assert found.text.startswith("finger 120 slipped by") and found.kind == "not"
    assert 4.0 <= found.t_s <= 4.5


def test_a_finger_that_takes_hold_elsewhere_is_no_slip():
    t_s, true, places, rng = held(np.random.default_rng(2))
    away = (t_s > 3.0) & (t_s < 3.6)
    places[away, 2, 1] += 0.03
    places[t_s >= 3.6, 2, 0] += 0.02
    (found,) = holds_of_fingers(seen(t_s, true, places, rng))
    assert found.text == "finger 240 took hold again, 20 mm away"
    assert 3.5 <= found.t_s <= 3.9


def test_a_finger_that_comes_back_to_its_place_says_nothing():
    t_s, true, places, rng = held(np.random.default_rng(3))
    places[(t_s > 3.0) & (t_s < 3.6), 2, 1] += 0.03
    assert holds_of_fingers(seen(t_s, true, places, rng)) == []


def test_a_finger_that_hovers_before_the_object_does_not_slip():
    t_s, true, places, rng = held(np.random.default_rng(5))
    places[:, 1, :] *= 1 + 0.012 / np.linalg.norm(places[0, 1]) * np.clip((t_s - 3.5) / 0.2, 0, 1)[:, None]
    places[:, 1, 2] += 0.03 * np.clip((t_s - 4.0) / 0.3, 0, 1)
    assert holds_of_fingers(seen(t_s, true, places, rng)) == []


def test_one_finger_that_pushes_slides_and_that_is_no_slip():
    t_s, true, places, rng = held(np.random.default_rng(4))
    places[:, 1:, :] += 0.1  # the others are away
    places[:, 0, 2] += 0.03 * np.clip((t_s - 4.0) / 0.3, 0, 1)
    assert holds_of_fingers(seen(t_s, true, places, rng)) == []


@pytest.mark.parametrize(("falls_within_s", "words"), [(0.2, "dropped"), (2.0, "put down")])
def test_the_way_of_the_object_has_its_turning_points(falls_within_s, words):
    t_s = np.arange(80) / 10
    height = 0.0325 + 0.05 * (np.clip(t_s - 1.0, 0, 1) - np.clip((t_s - 4.0) / falls_within_s, 0, 1))
    pose = np.stack([0 * t_s, 0 * t_s, height, 1 + 0 * t_s, *(0 * t_s,) * 3], axis=1)
    found = way_of_object(t_s, pose, np.array([0.0, 0.0, 0.0825]), 0.02)
    assert [moment.text for moment in sorted(found, key=lambda each: each.t_s)] in (
        ["lifted", "at the goal", "left the goal", words],
        ["lifted", "at the goal", words, "left the goal"],
    )


def test_a_change_that_is_taken_back_at_once_is_none():
    values = [0, 0, 1, 0, 0, 1, 1, 1, 0, 0]
    assert changes(len(values), lambda k, _: bool(values[k])) == [(5, True), (8, False)]


def test_points_are_turned_into_the_objects_frame():
    pose = np.array([[0.1, 0.0, 0.0, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]])  # a quarter turn about z
    assert np.allclose(in_object(np.array([[[0.1, 0.2, 0.0]]]), pose), [[[0.2, 0.0, 0.0]]])


def test_too_little_says_nothing():
    t_s, true, places, rng = held(np.random.default_rng(0), reports=4)
    assert holds_of_fingers(seen(t_s, true, places, rng)) == []
    assert way_of_object(t_s[:0], true[:0], None, 0.02) == []
