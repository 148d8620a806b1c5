"""Cases of the blind test on cubes: robots with one hidden effect, healthy ones, and some whose joints alone are wrong.

A case keeps what its session leaves to judge (replayed pushes, statistics of the tracker), so that simulating, which takes long,
needs no thresholds, and judging needs no simulation.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.bench.cube_sessions import healthy_physics, sessions_with_pushes
from sim_backend.reality_gap.knowledge.hidden import BESIDE_CUBE, OF_CUBE
from sim_backend.reality_gap.subjects.cube.replay import PushReplay, Replayed
from sim_backend.reality_gap.subjects.cube.summary import CubeEvidence, evidence_of
from sim_backend.reality_gap.subjects.cube.tracker import TrackerStatistics
from sim_backend.workers.pool import Workers

LEVELS = (1.0, 2.0, 5.0)
"""Times the detection limit."""


@dataclass(frozen=True)
class CubeCase:
    """What is hidden: nothing, one effect (``value`` has one number, or three), or an error of a joint.

    ``level`` is in times the detection limit; 0 for healthy robots and joint errors.
    """

    name: str
    seed: int
    effect: str
    level: float
    value: tuple[float, ...]


def effect_cases(count: int, seed: int, limits: Mapping[str, float]) -> list[CubeCase]:
    """Cases with effects: effects in turn, then levels in turn; sign and direction drawn."""
    cases = []
    for i in range(count):
        effect, level = tuple(OF_CUBE)[i % len(OF_CUBE)], LEVELS[(i // len(OF_CUBE)) % len(LEVELS)]
        value = _value(effect, level, limits, np.random.default_rng([seed, 1, i]))
        cases.append(CubeCase(f"effect-{i:03d}", 1000 * seed + i, effect, level, value))
    return cases


def null_cases(count: int, seed: int) -> list[CubeCase]:
    """Healthy robots."""
    return [CubeCase(f"null-{i:03d}", 1000 * seed + 400 + i, "", 0.0, ()) for i in range(count)]


def joint_cases(count: int, seed: int) -> list[CubeCase]:
    """Robots of which one joint is wrong."""
    cases = []
    for i in range(count):
        key, size = BESIDE_CUBE[i % len(BESIDE_CUBE)]
        cases.append(CubeCase(f"joint-{i:03d}", 1000 * seed + 800 + i, key, 0.0, (size,)))
    return cases


def _value(effect: str, level: float, limits: Mapping[str, float], rng: np.random.Generator) -> tuple[float, ...]:
    sign = 1.0 if rng.random() < 0.5 else -1.0
    parameter = PARAMETERS[OF_CUBE[effect]]
    if parameter.scope is Scope.VECTOR:
        direction = rng.normal(size=3)
        return tuple(level * limits[effect] * direction / np.linalg.norm(direction))
    if parameter.absent == parameter.lower:
        return (level * limits[effect],)
    limit = limits[effect] if effect in limits else limits[f"{effect}.{'up' if sign > 0 else 'down'}"]
    return (parameter.absent + sign * level * limit,)


def hidden_physics(case: CubeCase) -> Physics:
    """A healthy robot of the case's seed with what is hidden in it (n = 1)."""
    rng = np.random.default_rng([case.seed])
    physics = healthy_physics(rng, 1)
    if not case.effect:
        return physics
    if case.effect in OF_CUBE:
        value = np.array(case.value)
        return physics.changed({OF_CUBE[case.effect]: value[None] if len(value) > 1 else value})
    joints = physics.value(case.effect).copy()
    joints[0, rng.integers(9)] = case.value[0]
    return physics.changed({case.effect: joints})


class Simulate:
    """What a worker does: what the sessions of a group of cases leave to judge."""

    def __init__(self) -> None:
        self._replay = PushReplay()

    def __call__(self, group: Sequence[CubeCase], _: None = None) -> list[CubeEvidence]:
        """Of each case; a group is simulated at once."""
        physics = Physics.stack([hidden_physics(case) for case in group])
        return list(evidence_of(sessions_with_pushes(physics, [case.seed for case in group]), self._replay))


def gather(cases: Sequence[CubeCase], folder: Path, workers: Workers, together: int = 10) -> Iterator[int]:
    """Simulate the cases that have no evidence in ``folder`` yet, by workers that do :class:`Simulate`, so many in a group.

    Yields how many are done after each group.
    """
    missing = [case for case in cases if not (folder / f"{case.name}.npz").exists()]
    done = len(cases) - len(missing)
    groups = [missing[first : first + together] for first in range(0, len(missing), together)]
    for group, found in zip(groups, workers.map(groups), strict=True):
        for case, evidence in zip(group, found, strict=True):
            save_evidence(folder / f"{case.name}.npz", evidence)
        done += len(group)
        yield done


def save_evidence(path: Path, evidence: CubeEvidence) -> None:
    """Keep it, whole or not at all."""
    arrays = {f"{row.name}{i}": getattr(push, row.name) for i, push in enumerate(evidence.replayed) for row in fields(Replayed)}
    if evidence.tracker is not None:
        arrays["tracker"] = np.array(list(asdict(evidence.tracker).values()))
    part = path.with_suffix(".part.npz")
    np.savez_compressed(part, **arrays)
    part.replace(path)


def load_evidence(path: Path) -> CubeEvidence:
    """What :func:`save_evidence` kept."""
    with np.load(path) as file:
        count = sum(name.startswith("residual") for name in file.files)
        replayed = tuple(Replayed(*(file[f"{row.name}{i}"] for row in fields(Replayed))) for i in range(count))
        tracker = None
        if "tracker" in file.files:
            kinds = [int if row.type in (int, "int") else float for row in fields(TrackerStatistics)]
            values: list[Any] = [kind(value) for kind, value in zip(kinds, file["tracker"], strict=True)]
            tracker = TrackerStatistics(*values)
    return CubeEvidence(tracker, replayed)
