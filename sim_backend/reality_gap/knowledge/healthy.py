"""What healthy TriFingers look like: how far they lie from the nominal one, and what their sessions seem to have."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.ranges import load_ranges

JOINTS_FILE, CUBES_FILE = (Path(__file__).with_name(f"healthy_{name}.toml") for name in ("joints", "cubes"))
"""Ranges of what joints, and what trackers and cubes, are off by."""
SESSIONS_FILE = Path(__file__).with_name("healthy_joints.json")
LIMITS_FILE = Path(__file__).with_name("detection_limits.json")
"""Deviation of each number that joints show in half of all healthy sessions, by a test that is told effect and place."""
CUBES_OF_MANY_FILE = Path(__file__).with_name("cubes_of_many.json")
"""How numbers of pushes scatter about those of healthy sessions where a robot differs everywhere."""
STANDARD, STANDARD_S = "standard", 40.0
"""The excitation that limits were measured with, and how long its sessions are."""


def healthy_tolerances() -> dict[str, float]:
    """Standard deviation of each parameter of joints in a healthy robot, about the absent value, by "effect.parameter"."""
    found = {}
    for row in load_ranges(JOINTS_FILE).rows:
        low, high = row.low - row.parameter.absent, row.high - row.parameter.absent
        found[row.key] = float(np.sqrt((low * low + low * high + high * high) / 3.0))
    return found


@cache
def detection_limits() -> Mapping[str, float]:
    """Deviations from absent that half of all standard sessions show to a test that is told effect and place, by parameter."""
    return json.loads(LIMITS_FILE.read_text())["limits"]


def detection_limit(key: str, seconds: float) -> float:
    """That of a parameter in sessions of some length; 0 where none was measured.

    An effect's second number of the same unit, as the other axis of a tilt, has the first one's. Noise falls with the root of the
    time, what healthy robots differ by does not: this is the least that a longer session can show.
    """
    effect, unit = key.partition(".")[0], PARAMETERS[key].unit
    of_effect = [
        own for name, own in detection_limits().items() if name.startswith(f"{effect}.") and PARAMETERS[name].unit == unit
    ]
    own = detection_limits().get(key, of_effect[0] if of_effect else 0.0)
    return own * min(1.0, float(np.sqrt(STANDARD_S / seconds)))


@dataclass(frozen=True)
class HealthySessions:
    """What sessions of healthy robots look like to the study of joints, as it was measured on simulated ones.

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


NO_SESSIONS = HealthySessions({}, np.zeros(0), {})


@cache
def healthy_sessions(regimes: tuple[str, ...] = (STANDARD,)) -> HealthySessions:
    """Those of TriFingers that are kept with the code.

    Args:
        regimes: what each recording was made under. A single one is compared with sessions of its excitation, if these were
            measured, and several, whose gains add up, with sessions of all excitations but ``standard``, alone and together.
    """
    return sessions_of(json.loads(SESSIONS_FILE.read_text(encoding="utf-8")), regimes)


def sessions_of(kept: Mapping[str, Any], regimes: tuple[str, ...]) -> HealthySessions:
    """As :func:`healthy_sessions`, of a table as ``bench/joint_calibration_table.py`` makes it."""
    alone = {STANDARD: kept, **kept["alone"]}
    own = alone.get(regimes[0], kept["elsewhere"]) if len(regimes) == 1 else kept["elsewhere"]
    return HealthySessions(kept["tolerances"], np.sort(own["largest_gains"]), own["gates"], own.get("left_nats", 0.0))
