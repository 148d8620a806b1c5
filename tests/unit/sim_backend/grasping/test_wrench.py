"""What three fingertips can hold: cases whose answer is known."""

import numpy as np
import pytest

from sim_backend.grasping.wrench import LEVER_M, robust_wrench_measure, wrench_measure

FACING = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
PLACES = -LEVER_M * FACING
TWO_N = np.full(3, 2.0)


def test_two_facing_fingers_and_a_third_hold_with_friction():
    assert wrench_measure(PLACES, FACING, TWO_N, 1.0) > 0.5


def test_without_friction_nothing_resists_a_pull_upwards():
    assert wrench_measure(PLACES, FACING, TWO_N, 0.0) == pytest.approx(0.0, abs=1e-9)


def test_fingers_all_on_one_side_hold_nothing():
    one_side = np.tile([1.0, 0.0, 0.0], (3, 1))
    places = np.array([[-LEVER_M, offset, 0.0] for offset in (-0.01, 0.0, 0.01)])
    assert wrench_measure(places, one_side, TWO_N, 1.0) == 0.0


def test_it_is_a_force():
    once, twice = (wrench_measure(PLACES, FACING, force * TWO_N, 0.8) for force in (1.0, 2.0))
    assert twice == pytest.approx(2 * once)


def test_a_push_cannot_be_resisted_beyond_what_the_fingers_opposite_give():
    """From +y to -y only the third finger's press and the friction of the other two are there."""
    assert wrench_measure(PLACES, FACING, TWO_N, 0.5) <= 2.0 + 2 * 0.5 * 2.0


def test_the_robust_measure_is_the_worst_of_all_it_stands_for():
    plain = wrench_measure(PLACES, FACING, TWO_N, 0.5)
    assert robust_wrench_measure(PLACES, FACING, TWO_N, 0.5, 0.0) == pytest.approx(plain)
    assert robust_wrench_measure(PLACES, FACING, TWO_N, 0.5, 0.005) < plain


@pytest.mark.parametrize("seed", range(20))
def test_less_friction_is_never_better(seed):
    rng = np.random.default_rng(seed)
    places, force = PLACES + rng.uniform(-0.012, 0.012, (3, 3)), rng.uniform(0.8, 2.5, 3)
    measures = [wrench_measure(places, FACING, force, friction) for friction in (0.2, 0.5, 1.0)]
    assert measures == sorted(measures)


def test_many_at_once_are_as_one_after_the_other():
    many = wrench_measure(np.stack([PLACES, PLACES * 0.5]), np.stack([FACING, FACING]), np.stack([TWO_N, TWO_N]), 0.7)
    assert many.tolist() == [wrench_measure(places, FACING, TWO_N, 0.7) for places in (PLACES, PLACES * 0.5)]
