"""The axis of final position errors, the same on pages, in signed reports and in PDFs: logarithmic, in millimetres."""

import math

SMALLEST_MM, LARGEST_MM = 1.0, 400.0
TICKS_MM = (1, 3, 10, 30, 100, 300)
_GOLDEN = 0.618034


def held_mm(error_mm: float) -> float:
    """The error, or the end of the axis that it lies beyond."""
    return min(max(error_mm, SMALLEST_MM), LARGEST_MM)


def along(error_mm: float) -> float:
    """Where an error lies, from 0 at the smallest to 1 at the largest."""
    return math.log(held_mm(error_mm) / SMALLEST_MM) / math.log(LARGEST_MM / SMALLEST_MM)


def across(index: int) -> float:
    """Where the dot of the trial of this index lies across the axis, from 0 to 1: neighbours are far apart."""
    return index * _GOLDEN % 1
