"""Ways in which recordings may be misread: signs, units and clocks of joints, tried one by one."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim_backend.reality_gap.subjects.joints.verdicts.readings import (
    FEWEST_ROWS,
    Reading,
    ToldEpisode,
    TorqueRows,
    all_rows,
    errors_of,
    left_with_any_factor,
    left_with_factor,
    left_with_rotor,
)
from sim_backend.reality_gap.subjects.joints.verdicts.wording import listed

FALLS_TO = 0.7
"""A reading must leave no more of a joint's error than this: less than half of its variance. Right ones leave next to nothing."""
_BALANCE = 0.5
"""Of what a joint's inertia takes that nothing drives: a right reading leaves less, as friction and a constant are free."""
_NONE, _STRAY = 0.1, 0.01
"""A share of a joint's usual torque that is about none, and so many rows may be astray."""
_LATEST_S, _CLOCK_STEP_S = 0.1, 0.002
_PACES, _LEAST_PACE = np.linspace(0.8, 1.25, 91), 0.02
"""Of clocks, relative to the told one, and by how much one is off that no tolerated mass or inertia stands for."""
_UNIT_LEAVES = 1.0 / 3.0
"""Of what a joint's motion takes torques in another unit leave less; with any factor those of something else leave more."""
PLAUSIBLE_FACTOR = 2.0
"""A torque constant may be off by so much; beyond it a number is in another unit."""
_UNIT_NAMES = {1e-3: "as if mN m were read as N m", 1e3: "as if N m were read as mN m", 1e-2: "as if N cm were read as N m"}
_NEAR_UNIT = 1.15
_POSITION_UNITS = {
    np.pi / 180.0: "are in degrees, not in rad",
    180.0 / np.pi: "are in rad, not in degrees",
    2.0 * np.pi: "are in turns, not in rad",
}
_ZEROS_RAD = {np.pi: "half a turn", np.pi / 2.0: "a quarter turn", -np.pi / 2.0: "a quarter turn"}
_SLIDE_UNITS = {1e-3: "are in mm, not in m", 1e-2: "are in cm, not in m", 1e3: "are in m, not in mm", 1e2: "are in m, not in cm"}


@dataclass(frozen=True)
class Misreading:
    """A way to read the data with which the model agrees far better.

    Attributes:
        said: what would have to be so.
        check: what to look at.
        joints: that it is about.
        after_nm: root mean square torque error of each joint with it, friction and a constant set free, shape (k,).
        reading: the same as numbers.
    """

    said: str
    check: str
    joints: tuple[int, ...]
    after_nm: np.ndarray
    reading: Reading = field(repr=False)


def other_positions(data: Sequence[ToldEpisode], names: Sequence[str]) -> Iterator[Misreading]:
    """Signs and units of the positions, one joint or all of them, and what the torques then have to be."""
    k, is_slide = len(names), data[0].episode.plant.is_slide
    alike = [tuple(np.flatnonzero(each).tolist()) for each in (np.ones(k, bool), ~is_slide, is_slide)]
    choices = [(j,) for j in range(k)] + list(dict.fromkeys(joints for joints in alike if len(joints) > 1))
    for joints in choices:
        who, kinds = listed([names[j] for j in joints]), {bool(is_slide[j]) for j in joints}
        units = (_SLIDE_UNITS if kinds == {True} else _POSITION_UNITS) if len(kinds) == 1 else {}
        signs = {-1.0: "count the other way round"} if len(joints) in (1, k) else {}
        for factor, said in {**signs, **units}.items():
            by = np.ones(k)
            by[list(joints)] = factor
            check = f"the sign of {who}" if factor < 0.0 else f"position_unit of {who}"
            found = with_torques(all_rows(data, by), names, f"the positions of {who} {said}", check, joints, by)
            yield from (_as_told(each, data) for each in found if _balances(each, data))


def _as_told(found: Misreading, data: Sequence[ToldEpisode]) -> Misreading:
    """What is left with other units, of joints that nothing drives in the units that are told.

    Both sides of such a joint's equation are its own motion's: in a unit that makes it smaller whatever is left is smaller, too,
    right or wrong, and in one that makes it larger is larger, unless a motor elsewhere moves it. Where torques are given they say
    how large it has to be.
    """
    is_driven, plant = _driven(data), data[0].episode.plant
    is_moved = np.array([is_driven[plant.same_tree(j)].any() for j in range(len(is_driven))])
    by = np.abs(found.reading.positions)
    by = np.where(is_driven, 1.0, np.where(is_moved, np.minimum(by, 1.0), by))
    return replace(found, after_nm=found.after_nm / by)


def other_zeros(data: Sequence[ToldEpisode], names: Sequence[str]) -> Iterator[Misreading]:
    """Hinges that count from another side: 0 may be up, down or level."""
    same, plant = np.ones(len(names)), data[0].episode.plant
    for j in np.flatnonzero(~plant.is_slide).tolist():
        for by_rad, turn in _ZEROS_RAD.items():
            zeros_rad = np.where(np.arange(len(names)) == j, by_rad, 0.0)
            after = errors_of(all_rows(data, zeros_rad=zeros_rad))
            said, check = f"the zero of {names[j]} is {turn} away from the model's", f"zero of {names[j]}"
            found = Misreading(said, check, (j,), after, Reading(same, same, zeros_rad=zeros_rad))
            if _balances(found, data):
                yield found


def _balances(found: Misreading, data: Sequence[ToldEpisode]) -> bool:
    """Whether what nothing drives leaves far less than its own inertia takes; else it is not read right, but with less in it."""
    own_nm, is_driven = np.abs(found.reading.positions) * _own_nm(data), _driven(data)
    return all(is_driven[j] or found.after_nm[j] <= _BALANCE * own_nm[j] for j in found.joints if np.isfinite(found.after_nm[j]))


def _driven(data: Sequence[ToldEpisode]) -> np.ndarray:
    """Joints whose torques are more than what a sensor makes of none, shape (k,): beside a free motion that is little."""
    counts = [told.episode.valid_mechanics for told in data]
    return _rms([told.given for told in data], counts) > _NONE * _own_nm(data)


def _own_nm(data: Sequence[ToldEpisode]) -> np.ndarray:
    """What the inertia of each joint takes, as it is told, root mean square, shape (k,), N m."""
    inertia = [np.diagonal(told.episode.dynamics.by_acceleration, axis1=1, axis2=2) for told in data]
    own = [each * told.episode.path.acceleration for each, told in zip(inertia, data, strict=True)]
    return _rms(own, [told.episode.valid_mechanics for told in data])


def _rms(values: Sequence[np.ndarray], counts: Sequence[np.ndarray]) -> np.ndarray:
    """Of the rows of all episodes that count, shape (k,); 0 where none does."""
    rows = np.concatenate(counts)
    squares = np.where(rows, np.concatenate(values), 0.0) ** 2
    return np.sqrt(squares.sum(axis=0) / np.maximum(rows.sum(axis=0), 1))


def without_sign(rows: Sequence[TorqueRows]) -> list[int]:
    """Joints whose torques are all of one sign, and with that which the motion of the nominal model needs leave far less.

    Friction, a load or gravity that the model lacks keep torques on one side, too, which no other sign mends.
    """
    found = []
    for j, of_joint in enumerate(rows):
        given = of_joint.given
        if len(given) < FEWEST_ROWS:
            continue
        least = _NONE * float(np.sqrt(np.mean(given**2)))
        if least == 0.0 or min((given > least).mean(), (given < -least).mean()) > _STRAY:
            continue
        signed = replace(of_joint, given=np.abs(given) * np.sign(of_joint.needed))
        if left_with_factor(signed, 1.0) <= FALLS_TO * left_with_factor(of_joint, 1.0):
            found.append(j)
    return found


def with_torques(
    rows: Sequence[TorqueRows], names: Sequence[str], said: str, check: str, joints: tuple[int, ...], by: np.ndarray
) -> Iterator[Misreading]:
    """The positions as given (times ``by``), and each joint's torque turned round or in another unit where only this agrees.

    Not both units at once: smaller positions need smaller torques, which then leave smaller errors, whatever is right.
    """
    after, factors = errors_of(rows), np.ones(len(rows))
    turned: list[int] = []
    scaled: dict[int, float] = {}
    foreign: dict[int, float] = {}
    for j, of_joint in enumerate(rows):
        if not np.isfinite(after[j]):
            continue
        opposite, (free, factor, without) = left_with_factor(of_joint, -1.0), left_with_any_factor(of_joint)
        is_near = bool(joints) and free <= _UNIT_LEAVES * without and not _is_implausible(-factor)  # with a model a little off
        if opposite <= FALLS_TO * after[j] and (opposite <= free / FALLS_TO or is_near):
            after[j], factors[j] = opposite, -1.0
            turned.append(j)
        elif not joints and free <= FALLS_TO * min(after[j], without) and _is_implausible(factor):
            after[j], factors[j] = free, factor
            if free > _UNIT_LEAVES * without:
                foreign[j] = factor
            elif _is_implausible(-factor):
                scaled[j] = factor
            else:
                turned.append(j)
    touched, these = tuple(sorted({*joints, *turned, *scaled, *foreign})), [names[j] for j in turned]
    parts, checks = [said] if said else [], [check] if check else []
    if turned and set(turned) == set(joints) and "other way" in said:
        parts = [f"{listed([names[j] for j in joints])} counts the other way round, position and torque"]
    elif turned:
        parts.append(f"the torques of {listed(these)} have the opposite sign")
        checks.append(f"torque_sign of {listed(these)}")
    if scaled:
        said_so, check_so = _of_units_or_rotors(scaled, rows, names)
        parts.append(said_so)
        checks.append(check_so)
    if foreign:
        who = listed([names[j] for j in foreign])
        parts.append(f"{_of_units(foreign, names)}, or the torques of {who} are mostly not the joint's own")
        checks.append(f"torque_unit of {who} and what its torques hold")
    if parts:
        yield Misreading(" and ".join(parts), " and ".join(checks), touched, after, Reading(by, factors))


def _of_units_or_rotors(factors: dict[int, float], rows: Sequence[TorqueRows], names: Sequence[str]) -> tuple[str, str]:
    """What is said of torques in other units, and what to check: without gravity more rotor inertia may do as well."""
    who, light = listed([names[j] for j in factors]), [names[j] for j in factors if _may_lack_inertia(rows[j], factors[j])]
    said, check = _of_units(factors, names), f"torque_unit of {who}"
    if min(factors.values()) < 0.0:
        check = f"torque_unit and torque_sign of {who}"
    if not light:
        return said, check
    at = listed(light)
    return f"{said}, or the model lacks rotor inertia at {at}", f"the armature of {at} in the model and {check}"


def _may_lack_inertia(rows: TorqueRows, factor: float) -> bool:
    """Whether rotor inertia that the model lacks leaves about as small a share of the motion's torque as another unit does."""
    (free, _, needed), (left, inertia, given) = left_with_any_factor(rows), left_with_rotor(rows)
    return 0.0 < factor < 1.0 and inertia > 0.0 and left * needed <= free * given / FALLS_TO


def _of_units(factors: dict[int, float], names: Sequence[str]) -> str:
    """Of joints whose torques are in other units: all in one sentence where the factors are alike, else each by itself."""
    sizes = [abs(factor) for factor in factors.values()]
    if max(sizes) > _NEAR_UNIT**2 * min(sizes):
        return " and ".join(_of_units({j: factor}, names) for j, factor in factors.items())
    middle = float(np.sqrt(min(sizes) * max(sizes)))
    who, sign = listed([names[j] for j in factors]), " and have the opposite sign" if min(factors.values()) < 0.0 else ""
    at = next((at for at in _UNIT_NAMES if 1.0 / _NEAR_UNIT < middle / at < _NEAR_UNIT), None)
    middle, unit = (middle, "") if at is None else (at, f" ({_UNIT_NAMES[at]})")
    size = f"{_rounded(1.0 / middle)} times smaller" if middle < 1.0 else f"{_rounded(middle)} times larger"
    return f"the torques of {who} are {size}{unit}{sign}"


def _rounded(factor: float) -> str:
    return f"{factor:.0f}" if factor >= 100.0 else f"{factor:.3g}"


def _is_implausible(factor: float) -> bool:
    return not 1.0 / PLAUSIBLE_FACTOR < factor < PLAUSIBLE_FACTOR


def other_clocks(data: Sequence[ToldEpisode]) -> Iterator[Misreading]:
    """Torques that acted earlier or later than they are dated, all joints alike."""
    step_s = max(0.5 * data[0].episode.path.step_s, _CLOCK_STEP_S)  # a command that is held acts half a row later in the mean
    shifts_s = [s * step_s for s in range(-round(_LATEST_S / step_s), round(_LATEST_S / step_s) + 1) if s]
    errors = [errors_of(all_rows(data, late_s=shift_s)) for shift_s in shifts_s]
    if not errors:
        return
    best = int(np.argmin([float(np.nansum(np.log(error))) for error in errors]))
    late_ms, after = 1e3 * shifts_s[best], errors[best]
    when = "later" if late_ms < 0.0 else "earlier"
    joints = tuple(np.flatnonzero(np.isfinite(after) & _driven(data)).tolist())
    said = f"the torques acted {abs(late_ms):.3g} ms {when} than they are dated"
    same = np.ones(len(after))
    yield Misreading(said, "the clocks of positions and torques", joints, after, Reading(same, same, 1e-3 * late_ms))


def other_paces(data: Sequence[ToldEpisode], told: Sequence[TorqueRows], names: Sequence[str]) -> Iterator[Misreading]:
    """A clock that runs slow or fast: what moves slower needs less torque for its inertia, and as much for gravity.

    So does a model with another inertia: where that of each joint by itself leaves about as little, both are said.
    """
    slow, fast = (all_rows(data, pace=pace) for pace in (_PACES[0], _PACES[-1]))
    known = np.array([_PACES[0], 1.0, _PACES[-1]])

    def needed(j: int, pace: float) -> np.ndarray:
        """Torque is a polynomial of second degree in the pace."""
        weights = [np.prod((pace - np.delete(known, i)) / (known[i] - np.delete(known, i))) for i in range(3)]
        return weights[0] * slow[j].needed + weights[1] * told[j].needed + weights[2] * fast[j].needed

    def errors(pace: float) -> np.ndarray:
        return errors_of([TorqueRows(rows.given, needed(j, pace), rows.free, rows.rotor) for j, rows in enumerate(told)])

    by_pace = [errors(pace) for pace in _PACES]
    best = int(np.argmin([float(np.nansum(np.log(error))) for error in by_pace]))
    pace, after = float(_PACES[best]), by_pace[best]
    if abs(pace - 1.0) > _LEAST_PACE:
        joints, same = tuple(np.flatnonzero(np.isfinite(after)).tolist()), np.ones(len(after))
        more = {0: " or more", len(_PACES) - 1: " or less"}.get(best, "")
        said, check = f"a second of the recordings is {1.0 / pace:.3g} s{more}", "the times or the rate of rows"
        if all(left_with_rotor(told[j])[0] <= after[j] / FALLS_TO for j in joints):
            who = listed([names[j] for j in joints])
            said += f", or the model has too {'much' if pace < 1.0 else 'little'} inertia at {who}"
            check += f" and the inertia of {who} in the model,"
        yield Misreading(said, check, joints, after, Reading(same, same, pace=pace))
