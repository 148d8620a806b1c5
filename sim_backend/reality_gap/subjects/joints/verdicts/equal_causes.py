"""Causes that are the same numbers, whatever a robot does: a verdict that has one of them has the other, too.

Torques that are all off by one share are masses that all are; a torque that acts late is a position that is written late; a base
that is turned about the axis of the first joint is that joint's encoder, off by the same angle.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import LATE_TORQUE, OFFSET, TILT, TURNED
from sim_backend.reality_gap.knowledge.separation import separated_by
from sim_backend.reality_gap.knowledge.unnamed_laws import CONSTANT, MASS
from sim_backend.reality_gap.subjects.joints.laws.body_law import gravity_of, tilted_gravity
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import PLATFORM
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.verdict import Cause, Rival, Told, Verdict, VerdictKind

_OPEN = frozenset({VerdictKind.NAMED, VerdictKind.CONFUSABLE})
_SAME_GRAVITY, _LEAST_ACROSS = 0.01, 0.2
"""Shares of gravity: two that differ by less are the same; of one that lies so nearly along an axis no turn about it shows."""
_WEIGHTLESS = 0.1
"""Share of gravity: with less than this left it is no gravity that is a little off."""
_HELD_UP = 0.95
"""With less than this left no robot stands where there is so little."""
_LEAST_FACTOR = 1e-3
"""Of a mass: with less there is no link."""
_PAYLOAD = "the same motion with a payload of known mass at the last link"
_TRIFLE = 0.05
"""Of the larger of two tilts: the other is none."""


def with_share_of_all(verdict: Verdict, names: Sequence[str], is_driven: Sequence[bool], tolerated: float) -> Verdict:
    """A verdict that blames the masses of all links, or the torques of all motors, by one share: the other is as possible.

    Of a single joint both were compared in rollouts, if the other lies within its bounds; beyond them nobody asked.

    Args:
        verdict: what rollouts came to.
        names: of all joints.
        is_driven: which of them a torque drives; nobody blames the motor of another.
        tolerated: share by which masses may be off without being wrong, and so the shares of two joints from each other.
    """
    if len(names) == 1 and {MASS[0], CONSTANT[0]} <= {cause.effect for cause in verdict.causes}:
        return _of_one_link(verdict)
    if verdict.verdict is not VerdictKind.NAMED:
        return verdict
    driven = [name for name, drives in zip(names, is_driven, strict=True) if drives]
    for effect, other, places, other_places in ((MASS, CONSTANT, names, driven), (CONSTANT, MASS, driven, names)):
        own = {cause.where: cause for cause in verdict.causes if (cause.effect, cause.parameter) == effect}
        if not own or set(own) != set(places):
            continue
        factors = {name: _mass_factors(cause) for name, cause in own.items()}
        if max((1.0 - tolerated) * low for low, _, _ in factors.values()) > min(
            (1.0 + tolerated) * high for _, _, high in factors.values()
        ):
            continue
        middle = np.exp(np.mean(np.log(list(factors.values())), axis=0))
        as_other = [_of_mass_factors(other, name, factors.get(name, middle)) for name in other_places]
        bounds = PARAMETERS[".".join(other)]
        if len(names) == 1 and bounds.lower < as_other[0].value < bounds.upper:
            continue
        said = "Or all torques are off by one share: no motion tells that from all masses."
        return _confusable(verdict, said, own.values(), as_other, _PAYLOAD)
    return verdict


def _of_one_link(verdict: Verdict) -> Verdict:
    """A verdict in which both are possible: no pose tells a single link's mass from its motor's constant."""
    pose = separated_by(MASS[0], CONSTANT[0], "")

    def told(rival: Rival) -> Rival:
        return replace(rival, separated_by=_PAYLOAD) if rival.separated_by == pose else rival

    return replace(
        verdict,
        runner_up=None if verdict.runner_up is None else told(verdict.runner_up),
        rejected=tuple(map(told, verdict.rejected)),
        record_next=tuple(_PAYLOAD if each == pose else each for each in verdict.record_next),
    )


def _mass_factors(cause: Cause) -> tuple[float, float, float]:
    """A mass, or the torque constant that looks like it, as a factor of the mass: low end, value, high end."""
    (low, high), value = cause.interval_90, cause.value
    if (cause.effect, cause.parameter) == CONSTANT:
        low, value, high = _mass_of(high), _mass_of(value), _mass_of(low)
    return max(low, _LEAST_FACTOR), max(value, _LEAST_FACTOR), max(high, _LEAST_FACTOR)


def _of_mass_factors(parameter: tuple[str, str], where: str, factors: Sequence[float]) -> Cause:
    """The cause that looks like a mass with a factor: low end, value and high end."""
    low, value, high = map(float, factors)
    if parameter == CONSTANT:
        low, value, high = _constant_of(high), _constant_of(value), _constant_of(low)
    return Cause(*parameter, where, value, PARAMETERS[".".join(parameter)].unit, (low, high))


def with_late_columns(verdict: Verdict) -> Verdict:
    """A verdict that blames a delay that motions alone tell: positions that are written as late are the same numbers.

    A torque that acts late moves a joint late, and a joint whose position is written late seems to. Only a column that is on time
    with one of both tells them apart.

    Args:
        verdict: what rollouts came to.
    """
    delays = [cause for cause in verdict.causes if f"{cause.effect}.{cause.parameter}" == LATE_TORQUE]
    if verdict.verdict not in _OPEN or not delays:
        return verdict
    places = ", ".join(cause.where for cause in delays)
    late_ms = " to ".join(dict.fromkeys(f"{1e3 * end(cause.value for cause in delays):.2g}" for end in (min, max)))
    said = f"Positions that are written {late_ms} ms late ({places}) look like the delay."
    found = _confusable(verdict, said, delays, (), _ON_TIME)
    late = f"whether torques, or a servo's targets, act late or positions are written late ({places}): {_ON_TIME}"
    return replace(found, cannot_tell=(late, *verdict.cannot_tell))


def with_weight(verdict: Verdict, plant: Plant, state: JointState) -> Verdict:
    """A verdict that takes much gravity away: no robot falls up, but torques are often given without what gravity takes.

    Where a part of it is left something else may hold the weight up.

    Args:
        verdict: what rollouts came to.
        plant: whose joints.
        state: the model with the causes.
    """
    size = float(np.linalg.norm(plant.gravity_m_s2))
    is_blamed = verdict.verdict in _OPEN and any(cause.effect in TURNED for cause in verdict.causes)
    left = float(np.linalg.norm(gravity_of(state, plant.gravity_m_s2))) / size if is_blamed and size > 0.0 else 1.0
    if left > _WEIGHTLESS:
        return verdict if left > _HELD_UP else _held_up(verdict, 1.0 - left)
    said = "gravity takes no torque: torques are given without its share, or the robot does not stand as the model does"
    return replace(
        verdict,
        verdict=VerdictKind.UNEXPLAINED,
        summary=f"The robot goes where a model goes in which {said}.",
        causes=tuple(cause for cause in verdict.causes if cause.effect not in TURNED),
        extended=(),
        misreads=said,
        follows=(said, *verdict.follows),
        record_next=('nothing yet: give torques with gravity\'s share, or the model <option gravity="0 0 0"/>',),
        effects=tuple(
            replace(each, told=Told.NOT_JUDGED, because="what the torques are is open", above=None) for each in verdict.effects
        ),
    )


def _held_up(verdict: Verdict, share: float) -> Verdict:
    """A verdict that takes a share of gravity away that is too large for any place where a robot stands."""
    held = [cause for cause in verdict.causes if cause.effect in TURNED]
    said = f"Something else that holds up {share:.0%} of the weight looks like that, such as a controller that nobody told of."
    return _confusable(verdict, said, held, (), "the torques that act, measured: they show what a controller adds")


def with_turned_base(verdict: Verdict, plant: Plant, state: JointState) -> Verdict:
    """A verdict that blames a gravity that is turned about the first joint's axis, or that joint's encoder: it may be the other.

    Args:
        verdict: what rollouts came to.
        plant: whose joints.
        state: the model with the causes.
    """
    root = plant.root()
    if verdict.verdict not in _OPEN or root is None:
        return verdict
    joint, axis = root
    gravity = plant.gravity_m_s2
    size, across = float(np.linalg.norm(gravity)), float(np.linalg.norm(gravity - axis * (axis @ gravity)))
    turned = [cause for cause in verdict.causes if cause.effect in TURNED]
    offsets = [cause for cause in verdict.causes if cause.effect == OFFSET[0] and cause.where == plant.names[joint]]
    if across <= _LEAST_ACROSS * size or bool(turned) is bool(offsets):
        return verdict
    if turned:
        halves = [_half(cause) * (1.0 if cause.unit == "m/s^2" else size) for cause in turned]
        error, now = float(np.linalg.norm(halves)), gravity_of(state, gravity)
        angle_rad = float(np.arctan2(axis @ np.cross(gravity, now), gravity @ now - (axis @ gravity) * (axis @ now)))
        if np.linalg.norm(_about(axis, angle_rad, gravity) - now) > error + _SAME_GRAVITY * size:
            return verdict
        interval = (angle_rad - error / across, angle_rad + error / across)
        more = [Cause(*OFFSET, plant.names[joint], angle_rad, "rad", interval)]
    else:
        now, error = _about(axis, offsets[0].value, gravity), _half(offsets[0])
        tilt = least_squares(lambda tilts: tilted_gravity(gravity, *tilts) - now, np.zeros(2))
        if np.linalg.norm(tilt.fun) > _SAME_GRAVITY * size:
            return verdict
        tilts, least = zip(TILT, map(float, tilt.x), strict=True), _TRIFLE * float(np.abs(tilt.x).max())
        more = [Cause(*key, PLATFORM, by, "rad", (by - error, by + error)) for key, by in tilts if abs(by) > least]
    said = f"A base that is turned about the axis of {plant.names[joint]} and an encoder there that is off by the angle are one."
    own = turned or offsets
    return _confusable(verdict, said, own, more, separated_by(more[0].effect, own[0].effect, "a level on the base"))


def _about(axis: np.ndarray, angle_rad: float, vector: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(angle_rad * axis).apply(vector)


def _half(cause: Cause) -> float:
    return 0.5 * (cause.interval_90[1] - cause.interval_90[0])


def _confusable(verdict: Verdict, said: str, own: Iterable[Cause], more: Sequence[Cause], separates: str) -> Verdict:
    """A verdict with causes that are as possible as some of its own, and what to record to tell them apart."""
    kin = {cause.effect for cause in (*own, *more)}
    because = f"{said} What separates: {separates}"
    return replace(
        verdict,
        verdict=VerdictKind.CONFUSABLE,
        summary=f"{verdict.summary} {said}",
        causes=(*verdict.causes, *more),
        record_next=tuple(dict.fromkeys((separates, *verdict.record_next))),
        effects=tuple(
            replace(each, told=Told.CONFUSABLE, because=because, above=None) if each.effect in kin else each
            for each in verdict.effects
        ),
    )


_ON_TIME = (
    "the current of the motors in the same table: behind a delay it comes after its command, beside late positions it does not"
)


def _constant_of(factor: float) -> float:
    """Error of all motors' torques that looks like all masses with a factor."""
    return 1.0 / max(factor, _LEAST_FACTOR) - 1.0


def _mass_of(error: float) -> float:
    return 1.0 / max(1.0 + error, _LEAST_FACTOR)
