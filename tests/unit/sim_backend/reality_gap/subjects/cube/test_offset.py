"""The offset of a tracker, on tables that are made up."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.cube.offset import best_offset

FINE = np.linspace(-0.016, 0.016, 321)
HEIGHT = np.array([0.0, 0.0, 0.0, 0.0, 2000.0])


def _ways(rng: np.random.Generator) -> np.ndarray:
    """What an offset does: less and less per millimetre."""
    return np.tanh(FINE / 0.006)[:, None] * np.append(8.0 * rng.normal(size=4), 0.5)


@pytest.mark.parametrize("true_m", [(0.005, -0.004, 0.002), (-0.0082, 0.001, 0.0), (0.0, 0.0, -0.003)])
def test_an_offset_is_read_off_tables_that_bend(true_m):
    rng = np.random.default_rng(1)
    ways_x, ways_y = _ways(rng), _ways(rng)
    at = [int(np.abs(FINE - value).argmin()) for value in true_m[:2]]
    vector = ways_x[at[0]] + ways_y[at[1]] + true_m[2] * HEIGHT
    best, std, gain = best_offset(vector, FINE, ways_x, ways_y, HEIGHT)
    assert best == pytest.approx(true_m, abs=2e-4)
    assert gain == pytest.approx(0.5 * vector @ vector)
    assert (std > 0.0).all() and std[2] < 1e-3


def test_a_number_that_moves_nothing_does_no_harm():
    vector = 0.002 * HEIGHT
    best, std, gain = best_offset(vector, FINE, np.zeros((321, 5)), np.zeros((321, 5)), HEIGHT)
    assert best[2] == pytest.approx(0.002)
    assert std[0] > 1e3 * std[2]
    assert gain == pytest.approx(0.5 * vector @ vector)
