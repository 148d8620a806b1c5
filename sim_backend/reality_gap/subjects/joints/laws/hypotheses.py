"""What may be wrong with joints: the numbers of the catalogue's effects, and hypotheses as sets of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.reality_gap.knowledge.healthy import healthy_tolerances
from sim_backend.reality_gap.knowledge.joint_effects import (
    FITTED,
    NUMBERS,
    POSITION_GAIN,
    SCALES,
    JointEffect,
    Number,
    scales_everything,
)
from sim_backend.reality_gap.knowledge.known_of_robot import Robot, Tolerance, UnknownRobot
from sim_backend.reality_gap.subjects.joints.laws.heating import is_usual
from sim_backend.reality_gap.subjects.joints.laws.motor_law import GAP
from sim_backend.reality_gap.subjects.joints.laws.state import (
    CLOCK,
    LINK_CENTRES,
    LINK_INERTIA,
    SENSED,
    JointState,
    Term,
)

ALL_JOINTS = "all joints"
PLATFORM = "platform"

BEYOND_HEALTHY = 10.0
_OF_MOST = (-1 / 3, 1 / 3)
"""Shares of what a number cannot be much more than, by which it is probed."""
_CARRIES_NM = 0.24
"""Root mean square of what a TriFinger's first and second joints are sent in a standard session (0.21 to 0.27 in two robots)."""
CLOCK_TOLERANCE = 0.2
"""Standard deviation of when a torque acted, in samples: a quarter of one between a held torque and its mean over two."""

UNKNOWN_CLOCK = 0.5
"""The same of an unknown robot: nobody says whether a row's torque acts from its time on or about it."""


@dataclass(frozen=True)
class Hypothesis:
    """An effect at a place, as terms with the scale of each one's prior; ``is_part`` if another one has more of its numbers."""

    effect: str
    where: str
    terms: tuple[int, ...]
    scales: tuple[float, ...]
    is_part: bool = False

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


def joint_catalogue(
    names: Sequence[str],
    state: JointState,
    load_nm: np.ndarray,
    step_s: float,
    *,
    robot: Robot,
    start: JointState | None = None,
    centre_distance_m: np.ndarray | None = None,
    expects_many: bool = False,
) -> Catalogue:
    """Everything that may be wrong with k joints.

    Args:
        names: of the joints.
        state: the present model.
        load_nm: torques at full rate over all episodes, shape (s, k), N m: where saturation may begin.
        step_s: between samples.
        robot: what is known of it; healthy sessions seem to have something of effects that healthy robots do not have.
        start: the nominal model, whose own friction and rotors an unknown robot's may differ from; ``state`` if None.
        centre_distance_m: of the centre of mass of each joint's link, shape (k,); 0 if None.
        expects_many: whether causes beside others are to be told, which show less of their own shape.
    """
    terms: list[Term] = []
    begun = state if start is None else start
    families: dict[tuple[str, int], list[tuple[int, ...]]] = {}
    scales = {key: scale * state.size_of(key) for key, scale in SCALES.items()}
    for entry in FITTED.values():
        if entry.of_the_driver and isinstance(robot, UnknownRobot):
            continue
        for number in entry.numbers:
            for index in range(state.width(number.key)):
                families[(number.key, index)] = []
                for members in _members(number, index, (state, begun), load_nm, robot, expects_many=expects_many):
                    families[(number.key, index)].append(tuple(range(len(terms), len(terms) + len(members))))
                    terms += members
    clock = UNKNOWN_CLOCK if isinstance(robot, UnknownRobot) else CLOCK_TOLERANCE
    untold = [(Term(CLOCK, 0, step_s), clock * step_s), *((Term(SENSED, j, 1.0), 1.0) for j in range(len(names)))]
    if isinstance(robot, UnknownRobot):
        untold += links_off(robot.tolerance, np.zeros(len(names)) if centre_distance_m is None else centre_distance_m)
    terms += [term for term, _ in untold]
    healthy = {key: robot.granted * value for key, value in healthy_tolerances().items()}
    tolerance = np.zeros(len(terms))
    tolerance[len(terms) - len(untold) :] = [own for _, own in untold]
    for (key, _), members in families.items():
        # torques and masses of one finger trade places: what each seems to have is the other's
        usual = [] if scales_everything(key.partition(".")[0]) else robot.healthy.tolerances.get(key, [])
        for number, member in enumerate(members):
            for term in member:
                tolerance[term] = max(
                    healthy.get(key, 0.0) if number == 0 else 0.0, usual[number] if number < len(usual) else 0.0
                )
    if isinstance(robot, UnknownRobot):
        for (key, index), members in families.items():
            if members:
                first = members[0][0]
                of_model, late_s = own_share(robot.tolerance, key, index, start or state), NUMBERS[key].samples_off * step_s
                tolerance[first] = max(tolerance[first], of_model, late_s)
        return Catalogue(tuple(terms), tolerance, tuple(_hypotheses(names, families, scales)), scales)
    found = [
        replace(h, scales=tuple(_scale(scale, tolerance[term]) for term, scale in zip(h.terms, h.scales, strict=True)))
        for h in _with_single_numbers(_hypotheses(names, families, scales))
    ]
    return Catalogue(tuple(terms), tolerance, tuple(found), scales)


def with_controllers(catalogue: Catalogue, names: Sequence[str], driven: np.ndarray) -> Catalogue:
    """The same with position gains of controllers that drive some joints, shape (k,), where nobody recorded what they sent.

    Only simulated motions tell them: along the motion they are what the torques are made of.
    """
    joints, first, scale = np.flatnonzero(driven).tolist(), len(catalogue.terms), SCALES[POSITION_GAIN]
    if not joints:
        return catalogue
    terms = (*catalogue.terms, *(Term(POSITION_GAIN, j, scale / 100) for j in joints))
    found = _at_joints(FITTED[POSITION_GAIN.partition(".")[0]], names, {j: [(first + i,)] for i, j in enumerate(joints)}, scale)
    tolerance = np.concatenate([catalogue.tolerance, np.zeros(len(joints))])
    return Catalogue(terms, tolerance, (*catalogue.hypotheses, *found), catalogue.scales)


def without_play(catalogue: Catalogue, has_rotor: np.ndarray) -> Catalogue:
    """The same without play at joints whose model has no rotor, shape (k,): nobody knows what would cross it."""
    bare = {i for i, term in enumerate(catalogue.terms) if term.key == GAP and not has_rotor[term.index]}
    return replace(catalogue, hypotheses=tuple(h for h in catalogue.hypotheses if not bare & set(h.terms)))


def own_share(declared: Tolerance, key: str, index: int, start: JointState) -> float:
    """Standard deviation of what a model says of its own links, rotors and bearings, in the parameter's unit; 0 of all else."""
    name = NUMBERS[key].tolerated_as
    return 0.5 * getattr(declared, name) * abs(float(start.value(key)[index])) if name else 0.0


def links_off(declared: Tolerance, centre_distance_m: np.ndarray) -> list[tuple[Term, float]]:
    """What links may be off by without being wrong, each with its standard deviation."""
    joints = range(len(centre_distance_m))
    found = [(Term(LINK_INERTIA, j, 1.0), 0.5 * declared.inertia) for j in joints]
    centres = [0.5 * declared.centre * float(distance) for distance in centre_distance_m]
    return [*found, *((Term(key, j, 1e-3), centres[j]) for key in LINK_CENTRES for j in joints)]


def _scale(scale: float, tolerance: float) -> float:
    """A prior for a deviation: not much wider than what is healthy, or its width alone would hide small deviations."""
    return min(scale, BEYOND_HEALTHY * tolerance) if tolerance > 0.0 else scale


def _members(
    number: Number, index: int, states: tuple[JointState, JointState], load_nm: np.ndarray, robot: Robot, *, expects_many: bool
) -> list[list[Term]]:
    """The shapes in which a number may show, each as one term or two; of the present model and of the nominal one."""
    state, start = states
    key, by = number.key, state.size_of(number.key)
    scale = number.scale * by
    if number.begins_at_load:
        limit, load = state.value(key)[index], np.abs(load_nm[:, index])
        levels = load.max() * np.array(robot.load_shares)
        return [[Term(key, index, float(level - limit))] for level in levels if 0.02 < level < 0.995 * limit]
    shape = number.shape
    if shape is None:
        is_bounded = bool(number.probed_by) and isinstance(robot, UnknownRobot)
        most = abs(float(state.value(number.probed_by)[index])) if is_bounded else 0.0
        probes = [most * share for share in _OF_MOST] if most else [by * probe for probe in number.probes or (scale / by / 100,)]
        return [[Term(key, index, probe)] for probe in probes]
    extra = () if number.product_with is None else (number.product_with,)
    extra = tuple(
        (other, value * _hotter(load_nm[:, index], robot) if is_usual(start, other, index) else float(start.value(other)[index]))
        for other, value in extra
    )
    values = (*shape.values, *(shape.more if expects_many else ()))
    if extra and not is_usual(start, shape.key, index):  # as many as other joints have: groups of all take one of each
        values = (float(start.value(shape.key)[index]),) * len(values)
    members = [Term(key, index, scale / 100, ((shape.key, value), *extra)) for value in values]
    return [[term] for term in members] if shape.plane is None else [members]


def _hotter(load_nm: np.ndarray, robot: Robot) -> float:
    """Times that a motor gets hotter from each (N m)^2 than a TriFinger's: what it is sent in the mean makes it as hot.

    A small motor loses more for each (N m)^2 than any loss for each kelvin could be with a TriFinger's rise, and a large one so
    little that its image would be that of a motor without any torque.
    """
    mean_nm = np.sqrt(np.mean(load_nm**2))
    return float((_CARRIES_NM / mean_nm) ** 2) if isinstance(robot, UnknownRobot) and mean_nm > 0.0 else 1.0


def _hypotheses(
    names: Sequence[str], families: dict[tuple[str, int], list[tuple[int, ...]]], scales: Mapping[str, float]
) -> list[Hypothesis]:
    found: list[Hypothesis] = []
    for effect, entry in FITTED.items():
        keys = {number.key for number in entry.numbers}
        own = {place: members for place, members in families.items() if place[0] in keys}
        scale = scales[entry.numbers[0].key]
        if own and PARAMETERS[entry.numbers[0].key].scope is Scope.JOINT:
            found += _at_joints(entry, names, {index: members for (_, index), members in own.items()}, scale)
        elif own:
            shapes = [tuple(term for members in together for term in members) for together in zip(*own.values(), strict=True)]
            found += [Hypothesis(effect, PLATFORM, terms, (scale,) * len(terms)) for terms in shapes]
    return found


def _with_single_numbers(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Beside what the whole platform has in several numbers, each of these alone: gravity of another strength, or a tilt one way.

    Each number that a hypothesis has beyond what the data need takes a part of what it gains.
    """
    alone = [
        replace(h, terms=(term,), scales=(scale,), is_part=True)
        for h in hypotheses
        if h.where == PLATFORM and len(h.terms) > 1
        for term, scale in zip(h.terms, h.scales, strict=True)
    ]
    return [*hypotheses, *alone]


def _at_joints(
    entry: JointEffect, names: Sequence[str], own: Mapping[int, list[tuple[int, ...]]], scale: float
) -> list[Hypothesis]:
    """A hypothesis for each joint and shape, and for each shape one of all joints."""
    found = [Hypothesis(entry.effect, names[j], members, (scale,) * len(members)) for j, of in own.items() for members in of]
    several = {index: members for index, members in own.items() if members}
    if len(several) > 1 and not entry.scales_everything:
        for shapes in zip(*several.values(), strict=False):
            terms = tuple(term for members in shapes for term in members)
            found.append(Hypothesis(entry.effect, ALL_JOINTS, terms, (scale,) * len(terms)))
    return found
