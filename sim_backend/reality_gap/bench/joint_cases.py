"""Cases of the blind test: a robot with small errors everywhere, and one effect of a drawn size at a drawn place, or none."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Parameter, Scope
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.bench.joint_sessions import EVERYTHING, healthy_physics, simulated_recordings
from sim_backend.reality_gap.knowledge.healthy import STANDARD
from sim_backend.reality_gap.knowledge.hidden import AT_JOINTS
from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import PLATFORM
from sim_backend.trifinger import constants as c

MULTIPLES = (1.0, 2.0, 5.0)


@dataclass(frozen=True)
class Case:
    """What was hidden: ``effect`` is empty for a healthy robot, ``where`` a joint or the platform."""

    number: int
    seed: int
    effect: str = ""
    key: str = ""
    where: str = ""
    joint: int = 0
    multiple: float = 0.0
    value: float = 0.0

    def document(self) -> dict:
        """Plain values."""
        return asdict(self)


def draw_cases(seed: int, effects: int, nulls: int, limits: Mapping[str, float], keys: Sequence[str] = ()) -> list[Case]:
    """Cases of one blind test: every effect in turn, magnitudes in turn, places and signs drawn.

    Args:
        seed: of the test.
        effects: cases with an effect.
        nulls: cases without.
        limits: detection limit of each parameter, as a deviation from absent in its unit.
        keys: which parameters; all that joints can show if empty.
    """
    keys = [key for key in (keys or AT_JOINTS) if key in limits]
    cases = []
    for number in range(effects):
        key = keys[number % len(keys)]
        multiple = MULTIPLES[(number // len(keys) + number) % 3]
        cases.append(_drawn(number, seed, key, multiple, limits[key]))
    return cases + [Case(effects + number, _seed(seed, effects + number)) for number in range(nulls)]


def _seed(seed: int, number: int) -> int:
    return int(np.random.SeedSequence([seed, number, zlib.crc32(b"joints")]).generate_state(1)[0])


def _drawn(number: int, seed: int, key: str, multiple: float, limit: float) -> Case:
    rng = np.random.default_rng([seed, number])
    parameter, hidden = PARAMETERS[key], AT_JOINTS[key]
    is_joint = parameter.scope is Scope.JOINT
    joint = int(rng.integers(9)) if is_joint else hidden.axis
    deviation = multiple * limit * rng.uniform(0.95, 1.05)
    value = parameter.absent + _side(parameter, rng) * deviation
    if hidden.only_up:
        value = parameter.absent + deviation
    if hidden.is_whole:
        value = parameter.upper
    if hidden.joints:
        joint = int(rng.choice(hidden.joints))
    value = float(np.clip(value, parameter.lower, parameter.upper))
    where = c.JOINT_NAMES[joint] if is_joint else PLATFORM
    return Case(number, _seed(seed, number), hidden.effect, key, where, joint, multiple, value)


def _side(parameter: Parameter, rng: np.random.Generator) -> float:
    """To which side of absent an effect may deviate: drawn where it may to both."""
    if parameter.absent == parameter.lower:
        return 1.0
    return -1.0 if parameter.absent == parameter.upper else float(rng.choice([-1.0, 1.0]))


def physics_of(case: Case) -> Physics:
    """The robot of a case: healthy, and what was hidden in it."""
    healthy = healthy_physics(case.seed)
    if not case.effect:
        return healthy
    rng = np.random.default_rng([case.seed, 2])
    values = healthy.value(case.key).copy()
    if values.ndim == 1:
        values[0] = case.value
    else:
        values[0, case.joint] = case.value
    changes: dict = {case.key: values}
    hidden = AT_JOINTS[case.key]
    for key, share in hidden.beside:
        extra = np.zeros((1, 9))
        extra[0, case.joint] = share * case.value
        changes[key] = extra
    if hidden.drawn is not None:
        key, low, high = hidden.drawn
        changes[key] = rng.uniform(low, high)
    return healthy.changed(changes)


def keys_shown_by(excitation: str) -> tuple[str, ...]:
    """One number of each effect that is hidden where robots are seen by an excitation: an encoder jumps in the standard one."""
    return tuple(key for key, hidden in AT_JOINTS.items() if not hidden.comes_in_time or excitation in (STANDARD, EVERYTHING))


def recordings_of(cases: Sequence[Case], excitation: str = STANDARD) -> list[tuple[Recording, ...]]:
    """What a study has of the robots of some cases, seen by an excitation or by ``EVERYTHING``."""
    physics = Physics.stack([physics_of(case) for case in cases])
    in_time = {i: case for i, case in enumerate(cases) if case.key and AT_JOINTS[case.key].comes_in_time}
    for i, case in in_time.items():
        values = physics.value(case.key).copy()
        values[i] = PARAMETERS[case.key].absent
        physics = physics.changed({case.key: values})
    jumps = {i: (case.joint, case.value) for i, case in in_time.items()}
    return simulated_recordings(physics, [case.seed for case in cases], excitation, jumps=jumps)
