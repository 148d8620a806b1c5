"""Counts of lost frames and jumps."""

import pytest

from sim_backend.reality_gap.subjects.cube.counts import count_gain, count_p, healthy_count


def test_a_usual_count_gains_nothing_and_a_large_one_much():
    assert count_gain(1, 500, 0.002, 1.0) == pytest.approx(0.0, abs=1e-6)
    assert count_gain(20, 500, 0.002, 1.0) > 30.0


def test_where_robots_differ_a_large_count_says_less():
    assert count_gain(8, 500, 0.002, 2.0) < count_gain(8, 500, 0.002, 1.0)
    assert count_p(8, 500, 0.002, 2.0) > count_p(8, 500, 0.002, 1.0)


def test_the_probability_counts_the_event_itself():
    assert count_p(0, 500, 0.002, 1.5) == 1.0
    assert count_p(3, 500, 0.002, 1.5) == pytest.approx(1.0 - healthy_count(1.0, 1.5).cdf(2))
