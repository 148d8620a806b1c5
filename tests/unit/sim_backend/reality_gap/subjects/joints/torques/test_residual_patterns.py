"""What a residual follows that is left when all causes are in the model."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.torques.equations import Channel
from sim_backend.reality_gap.subjects.joints.torques.residual_patterns import (
    HATS,
    VARIABLES,
    hats,
    heat,
    patterns,
    since_reversal_s,
)
from tests.unit.sim_backend.reality_gap.subjects.joints.driven_joints import NO_LIMIT, drive, joints_model, problem

ENCODER_RAD = 3e-5
SECONDS = 12.0


def left(missing_nm, seed=0):
    position, torque = drive(joints_model(), SECONDS, missing_nm)
    position += ENCODER_RAD * np.random.default_rng(seed).standard_normal(position.shape)
    made = problem(position, torque)
    return patterns(made.episodes, made.look(NO_LIMIT, ()))


@pytest.fixture(scope="module")
def silent():
    return left(lambda velocity: 0.0 * velocity)


def test_white_noise_follows_nothing(silent):
    assert {p.variable for p in silent} == set(VARIABLES)
    assert {p.channel for p in silent} == {Channel.MECHANICS}
    assert len(silent) == 3 * len(VARIABLES)
    assert silent[0].gain < 5.0


def test_a_residual_that_follows_velocity_is_found_as_such():
    found = left(lambda velocity: np.array([0.0, 0.03, 0.0]) * np.exp(-((velocity - 1.0) ** 2) / 0.1))
    best = found[0]
    assert (best.channel, best.joint, best.variable) == (Channel.MECHANICS, 1, "velocity")
    others = [p.gain for p in found if p.joint == 1 and p.variable != "velocity"]
    assert best.gain > 1.5 * max(others)  # torques and positions go with velocities, for a part
    assert best.gain > 100.0
    assert max(p.gain for p in found if p.joint != 1) < 5.0


@pytest.mark.parametrize(("moments", "is_pattern"), [((6.0,), False), ((5.6,), False), ((4.4, 5.2, 6.0, 6.8), True)])
def test_what_happens_in_one_moment_is_no_pattern(moments, is_pattern):
    position, torque = drive(joints_model(), SECONDS)
    position += ENCODER_RAD * np.random.default_rng(0).standard_normal(position.shape)
    made = problem(position, torque)
    look = made.look(NO_LIMIT, ())
    (equation,) = (each for each in look.left if each.joint == 1)
    times = equation.time_s - equation.time_s[0]
    at = [np.abs(times - moment) < 0.3 for moment in moments]
    rare = replace(
        equation,
        residual=equation.residual + 0.02 * np.any([np.abs(times - moment) < 0.1 for moment in moments], axis=0),
        valid=equation.valid & (np.any(at, axis=0) | (times < 2.0) | (times > 10.0)),
    )
    found = patterns(made.episodes, replace(look, left=(rare,)))
    assert {p.variable for p in found if p.gain > 25.0} == (
        {"time", "heat"} if is_pattern else set()
    )  # it gets warmer all the time


def test_no_function_is_finer_than_the_noise_of_what_it_follows():
    series = np.random.default_rng(1).standard_normal(4000)
    fine, coarse = hats(series, 0.0), hats(series, 1.5)
    assert fine.shape == (4000, HATS)
    assert 3 <= coarse.shape[1] < HATS
    np.testing.assert_allclose(coarse.sum(axis=1), 1.0)
    assert not hats(series, 10.0).any(), "nothing but noise has nothing to follow"


def test_time_since_a_joint_turned_round():
    velocity = np.array([[1.0], [1.0], [-1.0], [-1.0], [-1.0], [1.0]])
    assert since_reversal_s(velocity, 0.3)[:, 0] == pytest.approx([1.0, 1.0, 0.0, 0.3, 0.6, 0.0])


def test_heat_comes_and_goes_within_ten_seconds():
    torque = np.concatenate([np.full((4000, 1), 0.5), np.zeros((1000, 1))])
    level = heat(torque, 0.01)[:, 0]
    assert level[999] == pytest.approx(0.25 * (1 - np.exp(-1)), rel=1e-3)
    assert level[-1] == pytest.approx(level[3999] * np.exp(-1), rel=1e-3)
