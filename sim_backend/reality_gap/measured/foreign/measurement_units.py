"""Units of foreign data: which exist for a quantity, and what one of each is in SI units."""

import math
import re
from enum import StrEnum

from sim_backend.reality_gap.recording import RecordingError


class Quantity(StrEnum):
    """What a column holds."""

    TIME = "time"
    ANGLE = "angle"
    LENGTH = "length"
    ANGULAR_VELOCITY = "angular velocity"
    VELOCITY = "velocity"
    TORQUE = "torque"
    FORCE = "force"
    TEMPERATURE = "temperature difference"
    VOLTAGE = "voltage"
    CURRENT = "current"
    NUMBER = "plain number"
    ANY = "any"


_DEG = math.pi / 180.0
UNITS: dict[Quantity, dict[str, float]] = {
    Quantity.TIME: {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    Quantity.ANGLE: {"rad": 1.0, "deg": _DEG, "mrad": 1e-3, "turn": 2.0 * math.pi},
    Quantity.LENGTH: {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6},
    Quantity.ANGULAR_VELOCITY: {"rad/s": 1.0, "deg/s": _DEG, "mrad/s": 1e-3, "rpm": math.pi / 30.0, "turn/s": 2.0 * math.pi},
    Quantity.VELOCITY: {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2},
    Quantity.TORQUE: {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2, "N mm": 1e-3},
    Quantity.FORCE: {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    Quantity.TEMPERATURE: {"K": 1.0, "degC": 1.0, "degF": 5.0 / 9.0},
    Quantity.VOLTAGE: {"V": 1.0, "mV": 1e-3},
    Quantity.CURRENT: {"A": 1.0, "mA": 1e-3},
    Quantity.NUMBER: {"1": 1.0, "%": 1e-2},
}
"""By quantity, what one of a unit is in SI units; the first of each is the SI unit."""
_SPELLINGS = {
    "sec": "s", "seconds": "s", "second": "s", "msec": "ms", "usec": "us", "nsec": "ns",
    "radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg", "rev": "turn", "turns": "turn",
    "rad s^-1": "rad/s", "deg s^-1": "deg/s", "m s^-1": "m/s", "rad/sec": "rad/s", "deg/sec": "deg/s", "rev/s": "turn/s",
    "Nm": "N m", "mNm": "mN m", "Ncm": "N cm", "Nmm": "N mm", "N.m": "N m", "C": "degC", "F": "degF", "celsius": "degC",
    "kelvin": "K", "volt": "V", "ampere": "A", "": "1",
}  # fmt: skip
_HEADER = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]$")


def si_factor(unit: str | float, quantity: Quantity, where: str) -> float:
    """What one of a unit is in SI units.

    Args:
        unit: its name, or a number that says how many SI units one unit of the column is.
        quantity: what the column holds; ``Quantity.ANY`` takes every unit.
        where: for the message.

    Raises:
        RecordingError: a unit that is unknown or of another quantity; the message lists those that are possible.
    """
    if not isinstance(unit, str):
        if not (math.isfinite(unit) and unit > 0.0):
            turned = "; sign and torque_sign say which way a joint's columns count" if unit < 0.0 else ""
            raise RecordingError(
                f"{where}: a unit of {unit!r} is not possible; a number says how many SI units one is, above 0{turned}"
            )
        return float(unit)
    possible = _possible(quantity)
    name = _spelled(unit)
    if name not in possible:
        raise RecordingError(
            f"{where}: unknown unit {unit!r} for {quantity.value}; choose from {', '.join(possible)}, "
            "or give the number of SI units that one is"
        )
    return possible[name]


def header_parts(header: str) -> tuple[str, str | None]:
    """Name and unit of a header such as ``q1 [deg]`` or ``tau (N m)``; None where it names no unit that is known."""
    match = _HEADER.match(header)
    if match is None or not match["name"] or not match["unit"].strip():
        return header, None
    unit = _spelled(match["unit"])
    known = any(unit in units for quantity, units in UNITS.items() if quantity is not Quantity.NUMBER)
    return (match["name"], unit) if known else (header, None)


def chosen_factor(stated: str | float | None, header: str | None, quantity: Quantity, where: str) -> float:
    """Factor to SI units from the unit that study.toml states and the one that the header does; SI where neither does.

    Raises:
        RecordingError: an unknown unit, or two that contradict each other.
    """
    if stated is None:
        return 1.0 if header is None else si_factor(header, quantity, where)
    factor = si_factor(stated, quantity, where)
    if isinstance(stated, str) and header is not None and not math.isclose(factor, si_factor(header, quantity, where)):
        raise RecordingError(
            f"{where}: the file's header says {header!r} and study.toml says {stated!r}; correct the one that is wrong "
            "(a number as unit overrules the header)"
        )
    return factor


def _possible(quantity: Quantity) -> dict[str, float]:
    if quantity is Quantity.ANY:
        return {name: factor for units in UNITS.values() for name, factor in units.items()}
    return UNITS[quantity]


def _spelled(unit: str) -> str:
    name = " ".join(unit.replace("·", " ").replace("*", " ").replace("µ", "u").replace("μ", "u").replace("°", "deg").split())
    return _SPELLINGS.get(name, name)
