"""Units mean what they say."""

import math

import pytest

from sim_backend.reality_gap.measured.foreign.measurement_units import UNITS, Quantity, chosen_factor, header_parts, si_factor
from sim_backend.reality_gap.recording import RecordingError


@pytest.mark.parametrize(
    ("unit", "quantity", "factor"),
    [
        ("deg", Quantity.ANGLE, math.pi / 180.0),
        ("°/s", Quantity.ANGULAR_VELOCITY, math.pi / 180.0),
        ("rpm", Quantity.ANGULAR_VELOCITY, 2.0 * math.pi / 60.0),
        ("N*m", Quantity.TORQUE, 1.0),
        ("mN·m", Quantity.TORQUE, 1e-3),
        ("Nm", Quantity.TORQUE, 1.0),
        ("µs", Quantity.TIME, 1e-6),
        ("°C", Quantity.TEMPERATURE, 1.0),
        ("mV", Quantity.ANY, 1e-3),
        (0.025, Quantity.TORQUE, 0.025),
    ],
)
def test_factors(unit, quantity, factor):
    assert si_factor(unit, quantity, "here") == pytest.approx(factor)


def test_every_quantity_begins_with_its_si_unit():
    assert all(next(iter(units.values())) == 1.0 for units in UNITS.values())


@pytest.mark.parametrize(
    ("header", "parts"),
    [
        ("q1 [deg]", ("q1", "deg")),
        ("tau(N m)", ("tau", "N m")),
        ("torque [Nm]", ("torque", "N m")),
        ("pos[0]", ("pos[0]", None)),
        ("q (raw)", ("q (raw)", None)),
        ("[deg]", ("[deg]", None)),
        ("plain", ("plain", None)),
    ],
)
def test_headers_with_units(header, parts):
    assert header_parts(header) == parts


def test_a_stated_unit_and_the_headers_must_agree_unless_a_number_overrules():
    assert chosen_factor(None, None, Quantity.ANGLE, "here") == 1.0
    assert chosen_factor(None, "deg", Quantity.ANGLE, "here") == pytest.approx(math.pi / 180.0)
    assert chosen_factor("Nm", "N m", Quantity.TORQUE, "here") == 1.0
    assert chosen_factor(1.0, "deg", Quantity.ANGLE, "here") == 1.0
    with pytest.raises(RecordingError, match=r"here.*deg.*rad"):
        chosen_factor("rad", "deg", Quantity.ANGLE, "here")
    with pytest.raises(RecordingError, match=r"here.*'deg' for torque"):
        chosen_factor(None, "deg", Quantity.TORQUE, "here")
