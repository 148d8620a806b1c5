"""What healthy TriFingers look like to the study of joints, as it was measured on simulated sessions."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

CALIBRATION_FILE = Path(__file__).with_name("calibration.json")
STANDARD = "standard"


@dataclass(frozen=True)
class Calibration:
    """What healthy sessions look like to this tool.

    Attributes:
        tolerances: standard deviation of each number that a healthy robot does not have, by parameter and shape.
        largest_gains: of healthy sessions, one each, nats, sorted.
        gates: gain that a cause of each effect must have, nats, by effect.
        left_nats: what functions of one variable, or values that no robot has, must gain to be no chance; 0 if not measured.
    """

    tolerances: Mapping[str, Sequence[float]]
    largest_gains: np.ndarray
    gates: Mapping[str, float]
    left_nats: float = 0.0

    def null_p(self, gain: float) -> float:
        """Share of healthy sessions whose largest gain is at least this one's."""
        return float((1 + np.sum(self.largest_gains >= gain)) / (1 + len(self.largest_gains)))


UNKNOWN = Calibration({}, np.zeros(0), {})
"""Of robots whose healthy sessions nobody knows."""


@cache
def calibration(regimes: tuple[str, ...] = (STANDARD,)) -> Calibration:
    """The calibration for TriFingers that is kept with the code; empty where there is none.

    Args:
        regimes: what each recording was made under. A single one is compared with sessions of its excitation, if these were
            measured, and several, whose gains add up, with sessions of all excitations but ``standard``, alone and together.
    """
    if not CALIBRATION_FILE.exists():
        return UNKNOWN
    kept = json.loads(CALIBRATION_FILE.read_text())
    alone = {STANDARD: kept, **kept["alone"]}
    own = alone.get(regimes[0], kept["elsewhere"]) if len(regimes) == 1 else kept["elsewhere"]
    return Calibration(kept["tolerances"], np.sort(own["largest_gains"]), own["gates"], own.get("left_nats", 0.0))
