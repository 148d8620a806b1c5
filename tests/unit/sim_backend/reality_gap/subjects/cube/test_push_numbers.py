"""Several numbers of hypotheses about pushes at once."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.cube.push_numbers import PushNumber, fitted


def number(way: np.ndarray, usual: float) -> PushNumber:
    """One that moves a session in proportion, about 0."""
    values = np.linspace(-2.0, 2.0, 401)
    return PushNumber(values, np.outer(values, way), 200, values / usual)


def test_without_data_a_number_is_as_unsure_as_it_usually_is_and_with_data_less():
    silent, seen = number(np.zeros(3), 0.1), number(np.array([10.0, 0.0, 0.0]), 0.1)
    assert fitted(np.zeros(3), [silent, silent]).std == pytest.approx([0.1, 0.1])
    assert fitted(np.zeros(3), [seen]).std == pytest.approx([0.1 / 2**0.5])
    assert fitted(np.zeros(3), []).half_left == 0.0


def test_two_that_look_alike_share_what_is_seen_by_what_is_less_far_fetched():
    way = np.array([10.0, 1.0])
    often, seldom = number(way, 1.0), number(way, 0.1)
    found = fitted(way, [often, seldom])
    assert found.values == pytest.approx([0.99, 0.01], abs=0.015)
    assert found.half_left == pytest.approx(0.5, rel=0.05)
    assert found.std[0] == pytest.approx(2**0.5 * 0.1, rel=0.02), "the error of what is seen, and what the other may be"


def test_numbers_of_their_own_ways_are_each_found():
    vector = np.array([5.0, -3.0, 0.0])
    found = fitted(vector, [number(np.array([10.0, 0.0, 0.0]), 10.0), number(np.array([0.0, 10.0, 0.0]), 10.0)])
    assert found.values == pytest.approx([0.5, -0.3], abs=0.011)
    assert found.half_left < 0.01
