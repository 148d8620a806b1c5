"""What may be wrong with joints: the numbers of the catalogue's effects, and hypotheses as sets of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sim_backend.effects.ranges import load_ranges
from sim_backend.reality_gap.joints.state import CLOCK, SENSED, JointState, Term, size_factor

HEALTHY = Path(__file__).with_name("healthy.toml")
"""How far healthy robots lie from the nominal one."""
ALL_JOINTS = "all joints"
PLATFORM = "platform"

SCALES: dict[str, float] = {
    "coulomb_friction.torque_nm": 0.05,
    "viscous_friction.damping_nm_s_rad": 0.02,
    "stribeck_friction.extra_nm": 0.03,
    "load_friction.coefficient": 0.15,
    "directional_friction.difference_nm": 0.03,
    "backlash.gap_rad": 0.01,
    "action_delay.delay_s": 0.005,
    "torque_constant.error": 0.1,
    "torque_saturation.limit_nm": 0.2,
    "supply_sag.loss_per_nm": 0.2,
    "thermal_derating.loss_per_k": 0.005,
    "cogging.amplitude_nm": 0.01,
    "link_mass.factor": 0.2,
    "rotor_inertia.armature_kg_m2": 5e-4,
    "joint_stiffness.stiffness_nm_rad": 0.02,
    "encoder_offset.offset_rad": 0.02,
    "velocity_filter.time_constant_s": 0.005,
    "position_gain.factor": 0.3,
    "safety_damping.factor": 0.3,
    "timing_jitter.std_s": 0.005,
    "controller_restart.off": 1.0,
    "table_tilt.roll_rad": 0.02,
    "table_tilt.pitch_rad": 0.02,
    "gravity.offset_m_s2": 0.1,
    "stribeck_friction.speed_rad_s": 0.1,
    "thermal_derating.time_constant_s": 20.0,
}
"""How large a deviation each number may have before its size speaks against it: a prior's standard deviation, in its unit."""

_PROBES: dict[str, tuple[float, ...]] = {
    "backlash.gap_rad": (0.003, 0.01, 0.03),
    "action_delay.delay_s": (0.001, 0.004, 0.015),
    "supply_sag.loss_per_nm": (0.05, 0.15, 0.4),
    "timing_jitter.std_s": (0.0005, 0.001, 0.002, 0.004),
    "directional_friction.difference_nm": (-0.01, 0.01),
}
"""Deviations at which the image of a number that is not linear is taken; others are probed at a hundredth of their scale."""

_SHAPES: dict[str, tuple[str, tuple[float, ...]]] = {
    "stribeck_friction.extra_nm": ("stribeck_friction.speed_rad_s", (0.04, 0.12, 0.35)),
    "thermal_derating.loss_per_k": ("thermal_derating.time_constant_s", (5.0, 30.0)),
    "joint_stiffness.stiffness_nm_rad": ("joint_stiffness.reference_rad", (-2.0, -1.0, 0.0, 1.0)),
    "cogging.amplitude_nm": ("cogging.phase_rad", (0.0, np.pi / 2)),
}
_SHAPES_OF_MANY = {"thermal_derating.loss_per_k": ("thermal_derating.time_constant_s", (5.0, 30.0, 300.0))}
"""A motor that warms over minutes looks like a torque constant, unless others pin that down."""
ONLY_SHAPES = ("stribeck_friction.speed_rad_s", "thermal_derating.time_constant_s")
"""These have a prior for when their effect is in the model; alone they are nothing."""
FITTED_RISE_K_NM2 = 2000.0
"""Only the product of this and the loss shows in motion; it is told for the catalogue's own (:mod:`.fitted_values`)."""
_PAIRED = ("cogging.amplitude_nm", "joint_stiffness.stiffness_nm_rad")
"""Their shapes span a plane: two images together stand for any phase, or any place of rest."""
SCALES_OF_EVERYTHING = ("torque_constant", "link_mass")
"""All torques and all masses may be off by the same share without any sign of it: these are only asked of single joints."""
_GLOBAL = ("supply_sag.loss_per_nm", "timing_jitter.std_s", "controller_restart.off")
_OF_THE_DRIVER = ("position_gain", "safety_damping", "timing_jitter", "controller_restart", "supply_sag")
"""What only a robot can have whose driver is known."""
BEYOND_HEALTHY = 10.0
FOREIGN_TOLERANCE = 0.2
"""Share of a healthy TriFinger's tolerances that any other robot is granted: its nominal model is all that is known of it."""
CLOCK_TOLERANCE = 0.2
"""Standard deviation of when a torque acted, in samples: a quarter of one between a held torque and its mean over two."""
_SATURATION_SHARES = (0.3, 0.5, 0.7, 0.85, 0.95)
_FOREIGN_SATURATION_SHARES = (0.05, 0.1, 0.2, *_SATURATION_SHARES)
"""Of the largest torque that was sent; nobody knows what an unknown driver may ask of its motors."""


@dataclass(frozen=True)
class Hypothesis:
    """An effect at a place, as terms with the scale of each one's prior."""

    effect: str
    where: str
    terms: tuple[int, ...]
    scales: tuple[float, ...]

    @property
    def name(self) -> tuple[str, str]:
        """Effect and place: several hypotheses may share it that differ in shape."""
        return self.effect, self.where


@dataclass(frozen=True)
class Catalogue:
    """All terms of a plant, the tolerance of each in a healthy robot, and all hypotheses.

    ``tolerance`` has shape (m,): standard deviations in the terms' units, 0 for what a healthy robot does not have; ``scales``
    are :data:`SCALES` for a robot of this size.
    """

    terms: tuple[Term, ...]
    tolerance: np.ndarray
    hypotheses: tuple[Hypothesis, ...]
    scales: Mapping[str, float]

    def without(self, effects: Sequence[str]) -> "Catalogue":
        """The same without some effects, neither as hypotheses nor in tolerances."""
        kept = tuple(h for h in self.hypotheses if h.effect not in effects)
        tolerance = np.array([0.0 if t.effect in effects else s for t, s in zip(self.terms, self.tolerance, strict=True)])
        return Catalogue(self.terms, tolerance, kept, self.scales)


def healthy_tolerances() -> dict[str, float]:
    """Standard deviation of each parameter in a healthy robot, from ``healthy.toml``, about the absent value."""
    found = {}
    for row in load_ranges(HEALTHY).rows:
        low, high = row.low - row.parameter.absent, row.high - row.parameter.absent
        found[row.key] = float(np.sqrt((low * low + low * high + high * high) / 3.0))
    return found


def joint_catalogue(
    names: Sequence[str],
    state: JointState,
    load_nm: np.ndarray,
    step_s: float,
    *,
    has_pipeline: bool,
    tolerances: Mapping[str, Sequence[float]],
    expects_many: bool = False,
) -> Catalogue:
    """Everything that may be wrong with k joints.

    Args:
        names: of the joints.
        state: the present model.
        load_nm: torques at full rate over all episodes, shape (s, k), N m: where saturation may begin.
        step_s: between samples.
        has_pipeline: whether the driver's own safety pipeline is known to have made the torques.
        tolerances: what healthy sessions seem to have of effects that healthy robots do not have, one number for each shape.
        expects_many: whether causes beside others are to be told, which show less of their own shape.
    """
    terms: list[Term] = []
    families: dict[tuple[str, int], list[tuple[int, ...]]] = {}
    shapes = _SHAPES | (_SHAPES_OF_MANY if expects_many else {})
    shares = _SATURATION_SHARES if has_pipeline else _FOREIGN_SATURATION_SHARES
    scales = {key: scale * size_factor(key, state.size) for key, scale in SCALES.items()}
    for key, scale in scales.items():
        if key in ONLY_SHAPES:
            continue
        if not has_pipeline and key.partition(".")[0] in _OF_THE_DRIVER:
            continue
        for index in range(state.width(key)):
            families[(key, index)] = []
            for members in _members(key, index, scale, state, load_nm, shares, shapes):
                families[(key, index)].append(tuple(range(len(terms), len(terms) + len(members))))
                terms += members
    terms.append(Term(CLOCK, 0, step_s))
    terms += [Term(SENSED, j, 1.0) for j in range(len(names))]
    granted = 1.0 if has_pipeline else FOREIGN_TOLERANCE
    healthy = {key: granted * value for key, value in healthy_tolerances().items()}
    tolerance = np.zeros(len(terms))
    tolerance[-1 - len(names)] = CLOCK_TOLERANCE * step_s
    tolerance[-len(names) :] = 1.0
    for (key, _), members in families.items():
        # torques and masses of one finger trade places: what each seems to have is the other's
        usual = tolerances.get(key, []) if key.partition(".")[0] not in SCALES_OF_EVERYTHING else []
        for number, member in enumerate(members):
            for term in member:
                tolerance[term] = max(
                    healthy.get(key, 0.0) if number == 0 else 0.0, usual[number] if number < len(usual) else 0.0
                )
    if not has_pipeline:
        return Catalogue(tuple(terms), tolerance, tuple(_hypotheses(names, families, scales)), scales)
    found = [
        replace(h, scales=tuple(_scale(scale, tolerance[term]) for term, scale in zip(h.terms, h.scales, strict=True)))
        for h in _hypotheses(names, families, scales)
    ]
    return Catalogue(tuple(terms), tolerance, tuple(found), scales)


def _scale(scale: float, tolerance: float) -> float:
    """A prior for a deviation: not much wider than what is healthy, or its width alone would hide small deviations."""
    return min(scale, BEYOND_HEALTHY * tolerance) if tolerance > 0.0 else scale


def _members(
    key: str, index: int, scale: float, state: JointState, load_nm: np.ndarray, shares: Sequence[float], shapes: Mapping
) -> list[list[Term]]:
    """The shapes in which a number may show, each as one term or two."""
    if key == "torque_saturation.limit_nm":
        limit, load = state.value(key)[index], np.abs(load_nm[:, index])
        levels = load.max() * np.array(shares)
        return [[Term(key, index, float(level - limit))] for level in levels if 0.02 < level < 0.995 * limit]
    if key in shapes:
        shape, values = shapes[key]
        if key in _PAIRED:
            return [[Term(key, index, scale / 100, ((shape, value),)) for value in values[:: max(1, len(values) - 1)][:2]]]
        extra = (("thermal_derating.rise_k_nm2", FITTED_RISE_K_NM2),) if key.startswith("thermal") else ()
        return [[Term(key, index, scale / 100, ((shape, value), *extra))] for value in values]
    by = size_factor(key, state.size)
    return [[Term(key, index, by * probe)] for probe in _PROBES.get(key, (scale / by / 100,))]


def _hypotheses(
    names: Sequence[str], families: dict[tuple[str, int], list[tuple[int, ...]]], scales: Mapping[str, float]
) -> list[Hypothesis]:
    found: list[Hypothesis] = []
    for key, scale in scales.items():
        effect = key.partition(".")[0]
        own = {index: members for (k, index), members in families.items() if k == key}
        if not own or effect in ("table_tilt", "gravity"):
            continue
        if key in _GLOBAL:
            found += [Hypothesis(effect, PLATFORM, m, (scale,) * len(m)) for m in own[0]]
            continue
        for index, members in own.items():
            found += [Hypothesis(effect, names[index], m, (scale,) * len(m)) for m in members]
        own = {index: members for index, members in own.items() if members}
        if len(own) > 1 and effect not in SCALES_OF_EVERYTHING:
            for shapes in zip(*own.values(), strict=False):
                terms = tuple(term for members in shapes for term in members)
                found.append(Hypothesis(effect, ALL_JOINTS, terms, (scale,) * len(terms)))
    for effect, keys in (
        ("table_tilt", ("table_tilt.roll_rad", "table_tilt.pitch_rad")),
        ("gravity", ("gravity.offset_m_s2",)),
    ):
        terms = tuple(m[0] for (key, _), members in families.items() if key in keys for m in members)
        found.append(Hypothesis(effect, PLATFORM, terms, tuple(scales[keys[0]] for _ in terms)))
    return found
