"""What recordings would have to be misread as for the model to agree: signs, units and clocks of joints, tried one by one.

Such an error is no effect of a robot. It makes all torques wrong at once, so that whatever cause is fitted takes over a part of
it. Each reading is therefore compared with the data as they are told, both with friction and a constant torque set free.

Readings that make motions or torques smaller leave smaller errors of torques, right or wrong. So a reading is said only if the
model, driven by the torques, also goes where the robot went, on stretches that friction was not fitted to and as a share of how
far it moved, and the data as they are told do not.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import COULOMB_FRICTION, VISCOUS_FRICTION
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.rollouts.open_loop import Losses, Motion, Rollouts, windows_of
from sim_backend.reality_gap.subjects.joints.torques.counted_rows import near_end
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations

FALLS_TO = 0.7
"""A reading must leave no more of a joint's error than this: less than half of its variance. Right ones leave next to nothing."""
CLOCK_FALLS_TO = 0.5
"""Of a shift of the clock; a lag is in many effects, so that it must do better than signs and units, which are in none."""
_LATEST_S, _CLOCK_STEP_S = 0.1, 0.002
_PACES, _LEAST_PACE = np.linspace(0.8, 1.25, 91), 0.02
"""Of clocks, relative to the told one, and by how much one is off that no tolerated mass or inertia stands for."""
_UNIT_LEAVES = 1.0 / 3.0
"""Of what a joint's motion takes torques in another unit leave less; with any factor those of something else leave more."""
PLAUSIBLE_FACTOR = 2.0
"""A torque constant may be off by so much; beyond it a number is in another unit."""
_BLURRED_RAD_S = 0.02
_FEWEST_ROWS = 100
_SAME = 0.05
"""Readings whose errors differ by less than this share do equally well."""
_GOES_TO = 0.5
"""Of the rollouts' error that the data as they are told have: a right sign or unit leaves a tenth of it and less."""
_WINDOW_S, _STRETCH_S, _MOST_WINDOWS = 0.4, 1.2, 120
_UNIT_NAMES = {1e-3: "as if mN m were read as N m", 1e3: "as if N m were read as mN m", 1e-2: "as if N cm were read as N m"}
_NEAR_UNIT = 1.15
_POSITION_UNITS = {
    np.pi / 180.0: "are in degrees, not in rad",
    180.0 / np.pi: "are in rad, not in degrees",
    2.0 * np.pi: "are in turns, not in rad",
}
_SLIDE_UNITS = {1e-3: "are in mm, not in m", 1e-2: "are in cm, not in m", 1e3: "are in m, not in mm", 1e2: "are in m, not in cm"}


@dataclass(frozen=True)
class Reading:
    """How to read the data: factors of each joint's positions and torques, shapes (k,), and of clocks.

    Torques are dated ``late_s`` too late, and the told clock lets ``pace`` pass for each second.
    """

    positions: np.ndarray
    torques: np.ndarray
    late_s: float = 0.0
    pace: float = 1.0


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


@dataclass(frozen=True)
class _Told:
    """One episode as it is told: torques given and needed, shapes (t, k), N m.

    What is needed has the friction that the model has: ``coulomb_nm`` and ``damping_nm_s_rad``, shapes (k,).
    """

    episode: EpisodeEquations
    given: np.ndarray
    needed: np.ndarray
    coulomb_nm: np.ndarray
    damping_nm_s_rad: np.ndarray


@dataclass(frozen=True)
class _Rows:
    """Of one joint, what counts of all episodes: torque given, torque needed, and what is set free, shapes (r,) and (r, 3)."""

    given: np.ndarray
    needed: np.ndarray
    free: np.ndarray


def misreading(
    episodes: Sequence[EpisodeEquations], start: JointState, names: Sequence[str], left_nm: np.ndarray
) -> Misreading | None:
    """The reading of the data that leaves the least, None if none leaves far less than the data as they are told.

    Args:
        episodes: of the study.
        start: the nominal model.
        names: of the joints.
        left_nm: torque error that the best explanation so far leaves at each joint, shape (k,), N m.
    """
    data = [_told(episode, start) for episode in episodes]
    rows = _all_rows(data)
    told = _errors(rows)
    limit = np.minimum(told, left_nm)
    found = [*_with_torques(rows, names, "", "", (), np.ones(len(names))), *_other_positions(data, names)]
    right = [m for m in found if _is_far_better(m, told, FALLS_TO * limit)]
    clocks = [*_other_clocks(data), *_other_paces(data, rows)]
    right += [m for m in clocks if _is_far_better(m, told, CLOCK_FALLS_TO * limit)]
    if not right:
        return None
    right = _that_roll_out(right, data)
    if not right:
        return None
    left = np.array([float(np.nanmean(np.log(m.after_nm / told))) for m in right])
    same = [m for m, value in zip(right, left, strict=True) if value < left.min() + _SAME]
    return _either(same)


def _that_roll_out(found: Sequence[Misreading], data: Sequence[_Told]) -> list[Misreading]:
    """Those with which the model goes where the robot went, and the data as they are told do not."""
    k = len(found[0].after_nm)
    told = _rollout_errors(data, Reading(np.ones(k), np.ones(k)))
    kept = []
    for each in found:
        ratio = _rollout_errors(data, each.reading) / told
        own = ratio[list(each.joints)]
        most = _GOES_TO if each.reading.pace == 1.0 else 1.0  # a clock that is a few per cent off is not all that is left
        if np.nanmax(own, initial=np.inf if np.isnan(own).all() else 0.0) <= most and np.nanmean(np.log(ratio)) < 0.0:
            kept.append(each)
    return kept


def _rollout_errors(data: Sequence[_Told], reading: Reading) -> np.ndarray:
    """Median over windows of how far each joint is from where it was, as a share of how far it moved, shape (k,)."""
    rows = _all_rows(data, reading.positions, reading.late_s, reading.pace, held_out=False)
    coulomb, damping, offset = (np.zeros(len(rows)) for _ in range(3))
    for j, of_joint in enumerate(rows):
        if len(of_joint.given) >= _FEWEST_ROWS:
            _, (coulomb[j], damping[j], offset[j]) = _rms_left(
                reading.torques[j] * of_joint.given - of_joint.needed, of_joint.free
            )
    coulomb += np.sign(reading.positions) * data[0].coulomb_nm  # beside what was needed as the positions are told
    damping += data[0].damping_nm_s_rad / (reading.positions * reading.pace)
    losses = Losses(np.maximum(coulomb, 0.0), np.maximum(damping, 0.0), -offset)
    motions, starts = zip(*(_motion(told, reading) for told in data), strict=True)
    many = max(1, round(sum(map(len, starts)) / _MOST_WINDOWS))
    errors = Rollouts(data[0].episode.plant).errors(motions, [each[::many] for each in starts], _WINDOW_S, losses)
    if not len(errors):
        return np.full(len(rows), np.nan)
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(errors).any(axis=0), np.nanmedian(errors, axis=0), np.nan)


def _motion(told: _Told, reading: Reading) -> tuple[Motion, np.ndarray]:
    """What was recorded, read so, and where the windows begin that friction was not fitted to."""
    episode, path = told.episode, told.episode.path
    torque, time_s = episode.acting_nm.T * reading.torques, path.recording.time_s
    if reading.late_s:
        torque = np.stack([np.interp(time_s + reading.late_s, time_s, column) for column in torque.T], axis=1)
    good = (episode.is_measured & ~near_end(path, episode.ends_rad)).all(axis=1)
    known = np.repeat(good, path.every)[: len(time_s)]
    held_out = _is_held_out(time_s - time_s[0])
    velocity, step_s = path.fast_velocity * reading.positions * reading.pace, path.step_s / reading.pace
    motion = Motion(path.fast_position * reading.positions, velocity, torque, step_s, known)
    return motion, windows_of(motion, _WINDOW_S, _WINDOW_S / 2, held_out)


def _is_held_out(time_s: np.ndarray) -> np.ndarray:
    """Every other stretch of an episode."""
    return np.floor(time_s / _STRETCH_S).astype(int) % 2 == 1


def _either(same: Sequence[Misreading]) -> Misreading:
    """One reading, or all that do equally well: an arm and its mirror image move alike."""
    fewest = min(len(m.joints) for m in same)
    first, *others = (m for m in same if len(m.joints) == fewest)
    said, check = (list(dict.fromkeys(getattr(m, name) for m in (first, *others))) for name in ("said", "check"))
    return replace(first, said=", or ".join(said), check=", or ".join(check))


def _is_far_better(found: Misreading, told: np.ndarray, limit: np.ndarray) -> bool:
    own = [j for j in found.joints if np.isfinite(told[j])]
    others = np.delete(found.after_nm / told, found.joints)
    return bool(own) and bool(np.all(found.after_nm[own] <= limit[own])) and not bool(np.any(others > 1.0 / FALLS_TO))


def _other_positions(data: Sequence[_Told], names: Sequence[str]) -> Iterator[Misreading]:
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
            yield from _with_torques(_all_rows(data, by), names, f"the positions of {who} {said}", check, joints, by)


def _with_torques(
    rows: Sequence[_Rows], names: Sequence[str], said: str, check: str, joints: tuple[int, ...], by: np.ndarray
) -> Iterator[Misreading]:
    """The positions as given (times ``by``), and each joint's torque turned round or in another unit where only this agrees.

    Not both units at once: smaller positions need smaller torques, which then leave smaller errors, whatever is right.
    """
    after, factors = _errors(rows), np.ones(len(rows))
    turned: list[int] = []
    scaled: dict[int, float] = {}
    foreign: dict[int, float] = {}
    for j, of_joint in enumerate(rows):
        if not np.isfinite(after[j]):
            continue
        opposite, (free, factor, without) = _left(of_joint, -1.0), _left_with_any_factor(of_joint)
        if opposite <= FALLS_TO * after[j] and opposite <= free / FALLS_TO:
            after[j], factors[j] = opposite, -1.0
            turned.append(j)
        elif not joints and free <= FALLS_TO * min(after[j], without) and _is_implausible(factor):
            after[j], factors[j] = free, factor
            (scaled if free <= _UNIT_LEAVES * without else foreign)[j] = factor
    touched, these = tuple(sorted({*joints, *turned, *scaled, *foreign})), [names[j] for j in turned]
    parts, checks = [said] if said else [], [check] if check else []
    if turned and set(turned) == set(joints) and "other way" in said:
        parts = [f"{listed([names[j] for j in joints])} counts the other way round, position and torque"]
    elif turned:
        parts.append(f"the torques of {listed(these)} have the opposite sign")
        checks.append(f"torque_sign of {listed(these)}")
    if scaled:
        parts.append(_of_units(scaled, names))
        checks.append(f"torque_unit of {listed([names[j] for j in scaled])}")
    if foreign:
        who = listed([names[j] for j in foreign])
        parts.append(f"the torques of {who} are mostly not the joint's own")
        checks.append(f"what the torques of {who} hold")
    if parts:
        yield Misreading(" and ".join(parts), " and ".join(checks), touched, after, Reading(by, factors))


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


def _other_clocks(data: Sequence[_Told]) -> Iterator[Misreading]:
    """Torques that acted earlier or later than they are dated, all joints alike."""
    step_s = max(0.5 * data[0].episode.path.step_s, _CLOCK_STEP_S)  # a command that is held acts half a row later in the mean
    shifts_s = [s * step_s for s in range(-round(_LATEST_S / step_s), round(_LATEST_S / step_s) + 1) if s]
    errors = [_errors(_all_rows(data, late_s=shift_s)) for shift_s in shifts_s]
    if not errors:
        return
    best = int(np.argmin([float(np.nansum(np.log(error))) for error in errors]))
    late_ms, after = 1e3 * shifts_s[best], errors[best]
    when = "later" if late_ms < 0.0 else "earlier"
    is_driven = np.any([told.given.any(axis=0) for told in data], axis=0)
    joints = tuple(np.flatnonzero(np.isfinite(after) & is_driven).tolist())
    said = f"the torques acted {abs(late_ms):.3g} ms {when} than they are dated"
    same = np.ones(len(after))
    yield Misreading(said, "the clocks of positions and torques", joints, after, Reading(same, same, 1e-3 * late_ms))


def _other_paces(data: Sequence[_Told], told: Sequence[_Rows]) -> Iterator[Misreading]:
    """A clock that runs slow or fast: what moves slower needs less torque for its inertia, and as much for gravity."""
    slow, fast = (_all_rows(data, pace=pace) for pace in (_PACES[0], _PACES[-1]))
    known = np.array([_PACES[0], 1.0, _PACES[-1]])

    def needed(j: int, pace: float) -> np.ndarray:
        """Torque is a polynomial of second degree in the pace."""
        weights = [np.prod((pace - np.delete(known, i)) / (known[i] - np.delete(known, i))) for i in range(3)]
        return weights[0] * slow[j].needed + weights[1] * told[j].needed + weights[2] * fast[j].needed

    def errors(pace: float) -> np.ndarray:
        return _errors([_Rows(rows.given, needed(j, pace), rows.free) for j, rows in enumerate(told)])

    by_pace = [errors(pace) for pace in _PACES]
    best = int(np.argmin([float(np.nansum(np.log(error))) for error in by_pace]))
    pace, after = float(_PACES[best]), by_pace[best]
    if abs(pace - 1.0) > _LEAST_PACE:
        joints, same = tuple(np.flatnonzero(np.isfinite(after)).tolist()), np.ones(len(after))
        said = f"a second of the recordings is {1.0 / pace:.3g} s"
        yield Misreading(said, "the times or the rate of rows", joints, after, Reading(same, same, pace=pace))


def _told(episode: EpisodeEquations, start: JointState) -> _Told:
    given = episode.path.smoothed(episode.acting_nm).T
    needed = given - episode.torque_error(start)
    return _Told(episode, given, needed, start.value(COULOMB_FRICTION), start.value(VISCOUS_FRICTION))


def _all_rows(
    data: Sequence[_Told],
    factor: np.ndarray | None = None,
    late_s: float = 0.0,
    pace: float = 1.0,
    *,
    held_out: bool | None = None,
) -> list[_Rows]:
    """Rows of each joint; positions times ``factor`` of shape (k,), torques as they are dated ``late_s`` after the motion.

    ``pace`` is that of the clock.

    ``held_out`` asks for one half of the stretches only.
    """
    parts = []
    for told in data:
        path, given, needed = told.episode.path, told.given, told.needed
        by = np.ones(path.position.shape[1]) if factor is None else factor
        velocity = path.velocity * by * pace
        if factor is not None or pace != 1.0:
            moved = (path.position * by, velocity, path.acceleration * by * pace**2)
            needed = needed + told.episode.plant.torque_nm(*moved) - told.episode.dynamics.torque_nm
        if late_s:
            given = np.stack([np.interp(path.time_s + late_s, path.time_s, column) for column in given.T], axis=1)
        counts = told.episode.valid_mechanics
        if held_out is not None:
            counts = counts & (_is_held_out(path.time_s - path.time_s[0]) == held_out)[:, None]
        parts.append((given, needed, velocity, counts))
    found = []
    for j in range(parts[0][0].shape[1]):
        given, needed, velocity = (np.concatenate([part[i][part[3][:, j], j] for part in parts]) for i in range(3))
        free = np.stack([np.tanh(velocity / _BLURRED_RAD_S), velocity, np.ones_like(velocity)], axis=1)
        found.append(_Rows(given, needed, free))
    return found


def _errors(rows: Sequence[_Rows]) -> np.ndarray:
    """What each joint leaves with its torques as they are, shape (k,), N m; NaN where too few rows count."""
    return np.array([_left(of_joint, 1.0) if len(of_joint.given) >= _FEWEST_ROWS else np.nan for of_joint in rows])


def _left(rows: _Rows, factor: float) -> float:
    return _rms_left(factor * rows.given - rows.needed, rows.free)[0]


def _left_with_any_factor(rows: _Rows) -> tuple[float, float, float]:
    """What is left with the best factor of the torques, that factor, and what is left without any torque."""
    left, coefficients = _rms_left(rows.needed, np.column_stack([rows.given, rows.free]))
    return left, float(coefficients[0]), _rms_left(rows.needed, rows.free)[0]


def _rms_left(values: np.ndarray, images: np.ndarray) -> tuple[float, np.ndarray]:
    coefficients = np.linalg.lstsq(images, values, rcond=None)[0]
    return max(float(np.sqrt(np.mean((values - images @ coefficients) ** 2))), 1e-12), coefficients


def listed(names: Sequence[str]) -> str:
    """As ``joint1, joint2 and joint3``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
