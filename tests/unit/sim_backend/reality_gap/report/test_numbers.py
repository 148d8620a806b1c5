import math

import numpy as np
import pytest

from sim_backend.reality_gap.report import numbers


@pytest.mark.parametrize(
    ("value", "unit", "ends", "text"),
    [
        (0.0312, "N m", (0.0274, 0.0351), "0.031 ± 0.004 N m (90 %)"),
        (0.0031, "rad", (0.0027, 0.0035), "3.1 ± 0.4 mrad (90 %)"),
        (0.031249, "N m", (0.029949, 0.032549), "0.0312 ± 0.0013 N m (90 %)"),
        (12345.6, "N/m", (11345.6, 13345.6), "12\u202f300 ± 1\u202f000 N/m (90 %)"),
        (3.21e8, "N/m", (2.9e8, 3.6e8), "(3.2 ± 0.3) × 10⁸ N/m (90 %)"),
        (2e-5, "kg m²", (1e-5, 6e-5), "2 × 10⁻⁵ kg m² (90 %: 1 × 10⁻⁵ to 6 × 10⁻⁵)"),
        (-0.5, "", (-0.6, -0.4), "−0.50 ± 0.10 (90 %)"),
        (1.0, "m", (1.0, 1.0), "1 m (no interval)"),
        (1.0, "m", (None, 2.0), "1 m"),
        (math.nan, "m", (0.0, 1.0), "unknown"),
    ],
)
def test_digits_follow_the_interval(value, unit, ends, text):
    assert numbers.quantity_with_interval(value, unit, ends) == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0031, "rad", "3.1 mrad"), (0.031, "m", "31 mm"), (3e-6, "s", "3 µs"), (0.031, "N m", "0.031 N m"),
        (0.0031, "N m s/rad", "3.1 mN m s/rad"), (0.0031, "m²", "0.0031 m²"), (0.0031, "m/s²", "3.1 mm/s²"),
        (0.0031, "mrad", "0.0031 mrad"), (0.031, "kg", "31 g"), (0.0, "rad", "0 rad"), (None, "rad", "unknown"),
        (100.0, "s", "100 s"), (123456.0, "", "123\u202f000"), (6.02e23, "", "6.02 × 10²³"),
    ],
)  # fmt: skip
def test_units_read_well_and_squares_are_left_alone(value, unit, text):
    assert numbers.quantity(value, unit) == text


@pytest.mark.parametrize("size", [1e-90, 1e-9, 3e-4, 0.5, 7e4, 1e12, 1e90])
def test_axes_hold_numbers_of_moderate_size(size):
    factor, unit = numbers.axis_unit(np.array([math.nan, -size, 0.0]), "N m")
    assert 1e-3 * (1.0 - 1e-9) <= size * factor < 1e5
    assert unit.endswith("N m")


@pytest.mark.parametrize("bad", [None, math.nan, math.inf, -math.inf, 1e300, "1"])
def test_what_is_no_number_is_missing(bad):
    assert numbers.real(bad) is None
    assert numbers.quantity(bad, "m") == numbers.number(bad) == numbers.count(bad) == numbers.percent(bad) == "unknown"
    assert np.isnan(numbers.column([bad])).all()
    assert numbers.interval([bad, 1.0]) is None


def test_a_small_probability_is_a_bound():
    assert numbers.probability(0.0) == "p < 0.001"
    assert numbers.probability(0.43) == "p = 0.43"
