"""Cases of the blind test: a robot with small errors everywhere, and one effect of a drawn size at a drawn place, or none."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.joints.hypotheses import PLATFORM
from sim_backend.reality_gap.joints.sessions import EVERYTHING, healthy_physics, simulated_recordings
from sim_backend.reality_gap.knowledge.robot import STANDARD
from sim_backend.reality_gap.recording import Recording
from sim_backend.trifinger import constants as c

MULTIPLES = (1.0, 2.0, 5.0)
JUMP = "encoder_jump.offset_rad"

_ONE_SIDED = {
    "coulomb_friction.torque_nm",
    "viscous_friction.damping_nm_s_rad",
    "stribeck_friction.extra_nm",
    "load_friction.coefficient",
    "backlash.gap_rad",
    "action_delay.delay_s",
    "supply_sag.loss_per_nm",
    "thermal_derating.loss_per_k",
    "cogging.amplitude_nm",
    "action_noise.white_nm",
    "rotor_inertia.armature_kg_m2",
    "joint_stiffness.stiffness_nm_rad",
    "encoder_quantisation.step_rad",
    "velocity_filter.time_constant_s",
    "joint_noise.position_rad",
    "joint_noise.velocity_rad_s",
    "joint_noise.torque_nm",
    "timing_jitter.std_s",
}
SHOWN_BY_JOINTS: tuple[str, ...] = (
    *sorted(_ONE_SIDED),
    "torque_constant.error",
    "torque_saturation.limit_nm",
    "directional_friction.difference_nm",
    "link_mass.factor",
    "encoder_offset.offset_rad",
    "joint_limits.lower_rad",
    "table_tilt.roll_rad",
    "gravity.offset_m_s2",
    "position_gain.factor",
    "safety_damping.factor",
    "stuck_joint.holding_torque_nm",
    JUMP,
    "controller_restart.off",
)
"""One number of every effect that logs of joints can show."""


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
    keys = [key for key in (keys or SHOWN_BY_JOINTS) if key in limits]
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
    parameter = PARAMETERS[key]
    joint = int(rng.integers(9)) if parameter.width == 9 else 2 if key.startswith("gravity") else 0
    where = c.JOINT_NAMES[joint] if parameter.width == 9 else PLATFORM
    deviation = multiple * limit * rng.uniform(0.95, 1.05)
    sign = 1.0 if key in _ONE_SIDED else float(rng.choice([-1.0, 1.0]))
    if key == "torque_saturation.limit_nm":
        value = parameter.upper - deviation
    elif key == "joint_limits.lower_rad":
        value = deviation  # inwards: outwards a soft limit holds
        joint = int(rng.choice([0, 1, 3, 4, 6, 7]))
        where = c.JOINT_NAMES[joint]
    elif key in ("stuck_joint.holding_torque_nm", "controller_restart.off"):
        value = parameter.upper
    else:
        value = parameter.absent + sign * deviation
    value = float(np.clip(value, parameter.lower, parameter.upper))
    return Case(number, _seed(seed, number), key.partition(".")[0], key, where, joint, multiple, value)


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
    if case.effect == "coulomb_friction":  # as real friction is: larger near standstill, and not the same in both directions
        for key, share in (("stribeck_friction.extra_nm", 0.03), ("directional_friction.difference_nm", 0.02)):
            extra = np.zeros((1, 9))
            extra[0, case.joint] = share * case.value
            changes[key] = extra
    if case.effect == "cogging":
        changes["cogging.phase_rad"] = rng.uniform(-np.pi, np.pi)
    if case.effect == "stribeck_friction":
        changes["stribeck_friction.speed_rad_s"] = rng.uniform(0.05, 0.25)
    if case.effect == "joint_stiffness":
        changes["joint_stiffness.reference_rad"] = rng.uniform(-2.0, 0.5)
    if case.effect == "thermal_derating":
        changes["thermal_derating.time_constant_s"] = rng.uniform(4.0, 20.0)
    return healthy.changed(changes)


def keys_shown_by(excitation: str) -> tuple[str, ...]:
    """One number of each effect that is hidden where robots are seen by an excitation: an encoder jumps in the standard one."""
    return tuple(key for key in SHOWN_BY_JOINTS if key != JUMP or excitation in (STANDARD, EVERYTHING))


def recordings_of(cases: Sequence[Case], excitation: str = STANDARD) -> list[tuple[Recording, ...]]:
    """What a study has of the robots of some cases, seen by an excitation or by ``EVERYTHING``."""
    physics = Physics.stack([physics_of(case) for case in cases])
    jumps = {i: (case.joint, case.value) for i, case in enumerate(cases) if case.key == JUMP}
    for i in jumps:
        jump = physics.value(JUMP).copy()
        jump[i] = 0.0
        physics = physics.changed({JUMP: jump})
    return simulated_recordings(physics, [case.seed for case in cases], excitation, jumps=jumps)
