"""What is more than chance in a session with a cube: shares of healthy sessions that have as much."""

from sim_backend.reality_gap.knowledge.cube import Kind
from sim_backend.reality_gap.subjects.cube.healthy import HealthyCubes

GATE_P = 0.0125
"""A gain that so many healthy sessions reach is chance; each kind of hypotheses has gains of its own."""
PUSH_GATE_P = 0.0075
"""As much for each of two gains of hypotheses about pushes: by all of them, and by all but the push that adds most."""
MISFIT_P = 0.0075
"""As much for the misfit of the whole vector, whatever causes it."""
MISFIT_OF_MANY_P = 0.03
"""As much for the misfit of pushes where a robot differs everywhere: more than any of the robots has that are known."""
PEAK_P = 0.005
"""As much for the number that is farthest off for itself."""
COUNT_P = 0.001
"""As much for losses and jumps that no hypothesis is there for."""
MARGIN = 5.0
"""Nats by which the best hypothesis must lead, or the next ones may be the cause as well: odds of 150, as of joints."""
MOST_LEFT, REMAINDER_P, REMAINDER_PEAK_P = 0.1, 0.05, 0.01
"""Something else is at work if a cause leaves more than this share of what is beyond a healthy session's misfit and that is more
than so many healthy sessions have, or if a number that it leaves is farther off than in so many."""


def gate_p(kind: Kind) -> float:
    """That of gains of a kind."""
    return PUSH_GATE_P if kind is Kind.PUSHES else GATE_P


def is_beyond_chance(calibration: HealthyCubes, kind: Kind, gain: float) -> bool:
    """Whether a gain of a kind, nats, is more than healthy sessions have."""
    return calibration.gain_p(kind, gain) <= gate_p(kind)
