"""What separates two effects: the part of the smaller change that the other cannot give."""

import numpy as np
import pytest

from sim_backend.reality_gap.bench.separating import _Given, separations


def given(*effects):
    return [_Given(effect, joint, {}) for effect, joint in effects]


def test_parallel_changes_are_not_separated_and_orthogonal_ones_by_the_smaller():
    changes = np.array([[3.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    found = separations(given(("a", 0), ("b", 0), ("c", 0)), changes)
    assert found == {("a", "b"): pytest.approx(0.0, abs=1e-12), ("a", "c"): pytest.approx(2.0), ("b", "c"): pytest.approx(1.0)}


def test_an_effect_with_two_shapes_spans_a_plane():
    changes = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.5]])
    found = separations(given(("cogging", 0), ("cogging", 0), ("b", 0)), changes)
    assert found["cogging", "b"] == pytest.approx(0.5)


def test_joints_are_compared_with_themselves_and_the_platform_with_all():
    changes = np.eye(3) * [[1.0], [2.0], [4.0]]
    found = separations(given(("a", 0), ("b", 1), ("gravity", None)), changes)
    assert found == {("a", "gravity"): pytest.approx(1.0), ("b", "gravity"): pytest.approx(2.0)}
