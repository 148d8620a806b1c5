"""How well each excitation separates two effects of a joint: ``python -m sim_backend.reality_gap.bench.separating --out FILE``.

Each effect is given alone, at ``MULTIPLE`` times its detection limit, to a robot without noise that is nominal otherwise. What it
changes in measured positions, velocities and torques, in units of the sensors' noise, is a direction; an effect with a free shape
(the phase of cogging) or with several numbers (gravity) spans a plane. What of the smaller change lies outside the other's plane
is what separates the two. Effects stand at one joint of a finger, all three in turn; the median over them is kept.
"""

import argparse
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy import ndimage

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.bench.joint_sessions import IN_THE_AIR, simulated_sessions
from sim_backend.reality_gap.knowledge.healthy import detection_limits
from sim_backend.reality_gap.knowledge.hidden import AT_JOINTS
from sim_backend.reality_gap.knowledge.joint_effects import FITTED, shape_of
from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.trifinger.scene import compile_scene

MULTIPLE = 2.0
SEED = 9101
JOINTS = (0, 1, 2)
NOISE = {"position_rad": 1e-4, "velocity_rad_s": 5e-3, "measured_torque_nm": 2e-3}
"""Of the sensors, about as a healthy robot has it."""
EVERY = 4  # samples
NEAR_END_RAD, NEAR_END_S = 0.05, 0.5
"""Around the ends of joints nothing is compared: so near, and so long before and after."""


@dataclass(frozen=True)
class _Given:
    """One robot: an effect, the joint where it is (None for the platform), and the numbers that it changes."""

    effect: str
    joint: int | None
    changes: Mapping[str, np.ndarray]


def _robots(limits: Mapping[str, float]) -> list[_Given]:
    """Every fitted effect of joints in each of its numbers, at each joint and in each shape."""
    found = []
    for effect, entry in FITTED.items():
        if AT_JOINTS[entry.numbers[0].key].is_whole:
            continue  # it has no size
        limit = limits[entry.numbers[0].key]
        for key in (number.key for number in entry.numbers):
            is_joint = PARAMETERS[key].scope is Scope.JOINT
            places = [(joint, joint) for joint in JOINTS] if is_joint else [(None, i) for i in range(PARAMETERS[key].width)]
            for joint, index in places:
                for shape in _shapes(effect):
                    found.append(_Given(effect, joint, _changes(key, index, limit) | shape))
    return found


def _shapes(effect: str) -> Iterable[dict[str, np.ndarray]]:
    """Values of the parameter that decides how an effect looks; one empty set where there is none."""
    shape = shape_of(effect)
    if shape is None:
        return [{}]
    return [{shape.key: np.full((1, PARAMETERS[shape.key].width), value)} for value in shape.values]


def _changes(key: str, index: int, limit: float) -> dict[str, np.ndarray]:
    parameter = PARAMETERS[key]
    values = np.full((1, parameter.width), parameter.absent)
    wanted = parameter.absent + MULTIPLE * limit
    values[0, index] = wanted if wanted <= parameter.upper else parameter.absent - MULTIPLE * limit
    within = np.clip(values, parameter.lower, parameter.upper)
    return {key: within[0] if parameter.scope is Scope.GLOBAL else within}


def directions(given: Sequence[_Given], excitation: str) -> np.ndarray:
    """What each robot measures otherwise than the nominal one, in units of noise, shape (robots, samples)."""
    physics = Physics.stack([Physics.nominal(), *(Physics.nominal().changed(dict(each.changes)) for each in given)])
    sessions = simulated_sessions(physics, [SEED] * (len(given) + 1), excitation=excitation, threads=2)
    counted = np.logical_and.reduce([_counted(session) for session in sessions])
    measured = np.stack([_measured(session, counted) for session in sessions])
    return measured[1:] - measured[0]


def _counted(session: Recording) -> np.ndarray:
    """Samples of each joint that a fit counts: away from its ends, where the smallest change shifts a hit; shape (s, k)."""
    assert session.joints is not None
    position, ends = session.joints.position_rad, Plant(compile_scene(), session.joints.names).range_rad
    near = (position < ends[:, 0] + NEAR_END_RAD) | (position > ends[:, 1] - NEAR_END_RAD)
    around = ndimage.binary_dilation(near, np.ones((round(NEAR_END_S / session.step_s), 1), dtype=bool))
    return np.logical_not(around)


def _measured(session: Recording, counted: np.ndarray) -> np.ndarray:
    """Everything that a robot measures where it counts, in units of noise, shape (samples,)."""
    parts = [np.where(counted, getattr(session.joints, name) / noise, 0.0)[::EVERY].ravel() for name, noise in NOISE.items()]
    return np.concatenate(parts).astype(np.float32)


def separations(given: Sequence[_Given], changes: np.ndarray) -> dict[tuple[str, str], float]:
    """For each pair of effects how much of the smaller change the other cannot give, in units of noise; median over joints."""
    planes: dict[tuple[str, int | None], list[np.ndarray]] = {}
    for each, change in zip(given, changes, strict=True):
        planes.setdefault((each.effect, each.joint), []).append(change)
    spans = {key: np.linalg.qr(np.stack(found).T.astype(float))[0] for key, found in planes.items()}
    found: dict[tuple[str, str], list[float]] = {}
    for first, second in combinations(planes, 2):
        at = {first[1], second[1]} - {None}
        if first[0] == second[0] or len(at) > 1:
            continue
        apart = min(_outside(planes[first], spans[second]), _outside(planes[second], spans[first]))
        found.setdefault((first[0], second[0]), []).append(apart)
    return {pair: float(np.median(values)) for pair, values in found.items()}


def _outside(changes: Sequence[np.ndarray], span: np.ndarray) -> float:
    return min(float(np.linalg.norm(change - span @ (span.T @ change))) for change in changes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulates every excitation and writes what separates what."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args(arguments).out
    given, kept = _robots(detection_limits()), {}
    for excitation in IN_THE_AIR:
        found = separations(given, directions(given, excitation))
        for (first, second), apart in found.items():
            kept.setdefault(f"{first} {second}", {})[excitation] = round(apart, 2)
        out.write_text(json.dumps({"multiple": MULTIPLE, "seed": SEED, "noise": NOISE, "apart": kept}, indent=1))
        print(excitation, flush=True)


if __name__ == "__main__":
    main()
