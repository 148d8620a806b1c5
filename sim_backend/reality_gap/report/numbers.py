"""Numbers as a reader wants them: a readable unit, and no more digits than the interval carries."""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

UNKNOWN = "unknown"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LARGEST, _SMALLEST = 1e100, 1e-100  # beyond these a number is a fault of a fit, and no plot can hold it
_PREFIXABLE = re.compile(r"^(N m|rad|N|V|A|W|J|m|s|Hz)(?![\w²³^*⁻])")
_SMALL_FOR = {"rad": 0.1, "m": 0.1, "s": 0.1}  # below this milli reads better; 0.01 for every other unit
_MOST_DIGITS = 6


def real(value: Any) -> float | None:
    """The number, or None for what is missing, not a number or not finite."""
    if value is None or isinstance(value, str):
        return None
    number_ = float(value)
    if not math.isfinite(number_) or abs(number_) > _LARGEST:
        return None
    return number_ if abs(number_) > _SMALLEST else 0.0


def column(values: Sequence[Any] | None, length: int = 0) -> np.ndarray:
    """Numbers with NaN for what is missing; ``length`` of NaN where the whole column is missing."""
    if values is None:
        return np.full(length, np.nan)
    numbers = [real(value) for value in values]
    return np.array([math.nan if value is None else value for value in numbers], dtype=float)


def interval(ends: Sequence[Any] | None) -> tuple[float, float] | None:
    """Both ends in order, or None if one is missing."""
    if ends is None or len(ends) != 2:
        return None
    low, high = real(ends[0]), real(ends[1])
    return None if low is None or high is None else (min(low, high), max(low, high))


def readable_unit(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which a number of this size reads well, such as 1000 and mrad for 0.0031 and rad."""
    unit = unit.strip()
    match = _PREFIXABLE.match(unit)
    if size == 0.0 or not match:
        return (1e3, "g") if unit == "kg" and 0.0 < size < 0.1 else (1.0, unit)
    if size >= _SMALL_FOR.get(match.group(1), 0.01):
        return 1.0, unit
    return (1e3, "m" + unit) if size >= 1e-4 else (1e6, "µ" + unit)


def axis_unit(values: np.ndarray, unit: str) -> tuple[float, str]:
    """Factor and unit for an axis that holds these values, with a power of ten where no prefix does."""
    finite = np.abs(values[np.isfinite(values)])
    size = float(finite.max()) if finite.size else 0.0
    factor, unit = readable_unit(size, unit)
    if size == 0.0 or 1e-3 <= size * factor < 1e5:
        return factor, unit
    power = 3 * math.floor(math.log10(size * factor) / 3)
    return factor / 10.0**power, f"{power_of_ten(power)} {unit}".strip()


def power_of_ten(power: int) -> str:
    """As 10⁻⁶."""
    return "10" + str(power).translate(_SUPERSCRIPTS)


def at_resolution(value: float, resolution: float) -> str:
    """The value rounded so that its last digit is of the size of ``resolution``, thousands apart, with a true minus."""
    size = max(abs(value), resolution)
    if size and not 1e-4 <= size < 1e6:
        power = math.floor(math.log10(size))
        mantissa = at_resolution(value / 10.0**power, resolution / 10.0**power)
        return f"{mantissa} × {power_of_ten(power)}"
    decimals = 0 if resolution <= 0.0 else -math.floor(math.log10(resolution) + 1e-9)
    text = f"{round(value, decimals):,.{max(decimals, 0)}f}".replace(",", "\u202f").replace("-", "−")
    return text.removeprefix("−") if not text.strip("−0.") else text


def number(value: Any, digits: int = 3) -> str:
    """To so many significant digits, trailing zeros of a whole number aside."""
    known = real(value)
    if known is None:
        return UNKNOWN
    if known == 0.0:
        return "0"
    rounded = float(f"{known:.{digits}g}")
    resolution = 10.0 ** (math.floor(math.log10(abs(rounded))) - digits + 1)
    text = at_resolution(rounded, resolution)
    return text.rstrip("0").removesuffix(".") if "." in text and " " not in text else text


def count(value: Any) -> str:
    """A whole number with its thousands apart."""
    known = real(value)
    return UNKNOWN if known is None else f"{round(known):,}".replace(",", "\u202f").replace("-", "−")


def with_unit(text: str, unit: str) -> str:
    """Number and unit, or the number alone where it has none."""
    return f"{text} {unit}".strip()


def quantity(value: Any, unit: str, digits: int = 3) -> str:
    """A number without an interval in a readable unit."""
    known = real(value)
    if known is None:
        return UNKNOWN
    factor, unit = readable_unit(abs(known), unit)
    return with_unit(number(known * factor, digits), unit)


def quantity_with_interval(value: Any, unit: str, ends: Sequence[Any] | None, level: str = "90 %") -> str:
    """As ``0.031 ± 0.004 N m (90 %)``, or with both ends where the interval is lopsided; digits by the interval."""
    known, between = real(value), interval(ends)
    if known is None or between is None:
        return quantity(value, unit)
    factor, unit = readable_unit(max(abs(known), abs(between[0]), abs(between[1])), unit)
    known, low, high = known * factor, between[0] * factor, between[1] * factor
    half = (high - low) / 2.0
    if half == 0.0:
        return f"{with_unit(number(known), unit)} (no interval)"
    step = resolution_of(half, known)
    if abs((low + high) / 2.0 - known) <= 0.2 * half and half < 10.0 * abs(known):
        power = _common_power(known, half)
        shown, spread = (at_resolution(part / 10.0**power, step / 10.0**power) for part in (known, half))
        shown = f"{shown} ± {spread}" if power == 0 else f"({shown} ± {spread}) × {power_of_ten(power)}"
        return f"{with_unit(shown, unit)} ({level})"
    shown, low_, high_ = (_not_lost(part, step) for part in (known, low, high))
    return f"{with_unit(shown, unit)} ({level}: {low_} to {high_})"


def percent(share: Any, digits: int = 0) -> str:
    """A share as percent, without the sign."""
    known = real(share)
    return UNKNOWN if known is None else at_resolution(100.0 * known, 10.0**-digits)


def probability(p: Any) -> str:
    """As ``p = 0.002``, or a bound where it is smaller than can be counted."""
    known = real(p)
    if known is None:
        return f"p {UNKNOWN}"
    return "p < 0.001" if known < 0.0005 else f"p = {number(known, 2)}"


def resolution_of(half_width: float, value: float) -> float:
    """Place of the last digit worth printing: one digit of the half width, two if it starts with 1, six of the value at most."""
    place = math.floor(math.log10(half_width))
    step = 10.0 ** (place - 1 if half_width / 10.0**place < 1.95 else place)
    return max(step, 10.0 ** (math.floor(math.log10(abs(value))) - _MOST_DIGITS + 1)) if value else step


def _common_power(value: float, half: float) -> int:
    size = max(abs(value), half)
    return 0 if 1e-4 <= size < 1e6 else math.floor(math.log10(size))


def _not_lost(value: float, step: float) -> str:
    return number(value, 2) if 0.0 < abs(value) < step else at_resolution(value, step)
