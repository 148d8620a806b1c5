"""The noise of a sensor is told from its motion, also where rows are few for the motion."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from sim_backend.reality_gap.measured.sensor_noise import white_noise

NOISE_RAD = 1e-4


def reported(quickest_hz: float, rows_hz: float) -> np.ndarray:
    rng, time_s = np.random.default_rng(0), np.arange(0.0, 20.0, 1.0 / rows_hz)
    motion = 0.5 * np.sin(2.0 * np.pi * quickest_hz * time_s) + 0.2 * np.sin(2.3 * quickest_hz * time_s + 1.0)
    return (motion + NOISE_RAD * rng.standard_normal(len(time_s)))[:, None]


@pytest.mark.parametrize(
    ("quickest_hz", "rows_hz"), [(2.0, 25.0), (3.0, 30.0), (3.0, 25.0), (3.0, 50.0), (1.0, 100.0), (1.0, 1000.0), (0.3, 25.0)]
)
def test_of_a_motion_that_is_quick_for_its_rows_the_noise_alone_counts(quickest_hz, rows_hz):
    assert white_noise(reported(quickest_hz, rows_hz))[0] == pytest.approx(NOISE_RAD, rel=0.3)


@pytest.mark.parametrize("order", [1, 2, 4])
def test_of_noise_that_a_filter_has_smoothed_no_less_counts_than_fourth_differences_show(order):
    white = np.random.default_rng(1).standard_normal((4000, 1))
    smooth = lfilter(*butter(order, 0.3), white, axis=0)
    fourth = np.median(np.abs(np.diff(smooth, 4, axis=0))) / (0.6745 * np.sqrt(70.0))
    assert white_noise(smooth)[0] == pytest.approx(fourth, rel=1e-3)


def test_what_is_missing_or_short_is_no_noise():
    series = np.hstack([reported(3.0, 25.0), reported(3.0, 25.0), np.full((500, 1), np.nan)])
    series[::40, 1] = np.nan
    assert white_noise(series) == pytest.approx([NOISE_RAD, NOISE_RAD, 0.0], rel=0.3)
    assert white_noise(series[:3]).tolist() == [0.0, 0.0, 0.0]
    assert np.isfinite(white_noise(series[:20])).all()
