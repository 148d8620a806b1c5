"""What recordings would have to be misread as for the model to agree: signs, units and clocks of joints, tried one by one.

Such an error is no effect of a robot. It makes all torques wrong at once, so that whatever cause is fitted takes over a part of
it. Each reading is therefore compared with the data as they are told, both with friction and a constant torque set free.

Readings that make motions or torques smaller leave smaller errors of torques, right or wrong. So a reading is said only if the
model, driven by the torques, also goes where the robot went, on stretches that friction was not fitted to and as a share of how
far it moved, and the data as they are told do not.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import VISCOUS_FRICTION
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.rollouts.open_loop import Losses, Motion, Rollouts, windows_of
from sim_backend.reality_gap.subjects.joints.torques.counted_rows import near_end
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.verdicts.heavier_links import or_heavier_link
from sim_backend.reality_gap.subjects.joints.verdicts.readings import (
    FEWEST_ROWS,
    Reading,
    ToldEpisode,
    all_rows,
    errors_of,
    is_held_out,
    rms_left,
    told_by,
)
from sim_backend.reality_gap.subjects.joints.verdicts.turned_gravity import or_turned_gravity
from sim_backend.reality_gap.subjects.joints.verdicts.ways_to_misread import (
    FALLS_TO,
    Misreading,
    other_clocks,
    other_paces,
    other_positions,
    other_zeros,
    with_torques,
)

CLOCK_FALLS_TO = 0.5
"""Of a shift of the clock; a lag is in many effects, so that it must do better than signs and units, which are in none."""
_SAME = 0.05
"""Readings whose errors differ by less than this share do equally well."""
_GOES_TO = 0.5
"""Of the rollouts' error that the data as they are told have: a right sign or unit leaves a tenth of it and less."""
_STANDS = 1.0
"""Of how far a joint moved: a model that ends up further off than one that stands still does not go where the robot went."""
_WINDOW_S, _MOST_WINDOWS = 0.4, 120


def misreading(
    episodes: Sequence[EpisodeEquations],
    start: JointState,
    names: Sequence[str],
    left_nm: np.ndarray,
    *,
    with_clocks: bool = True,
) -> Misreading | None:
    """The reading of the data that leaves the least, None if none leaves far less than the data as they are told.

    Args:
        episodes: of the study.
        start: the nominal model.
        names: of the joints.
        left_nm: torque error that the best explanation so far leaves at each joint, shape (k,), N m.
        with_clocks: whether clocks are asked for, too; they take more rows than signs, zeros and units.
    """
    data = [told_by(episode, start) for episode in episodes]
    rows = all_rows(data)
    told = errors_of(rows)
    if not np.isfinite(told).any():
        return None
    limit = np.minimum(told, left_nm)
    found = [*with_torques(rows, names, "", "", (), np.ones(len(names))), *other_positions(data, names)]
    found += other_zeros(data, names)
    right = [m for m in found if _is_far_better(m, told, FALLS_TO * limit)]
    clocks = [*other_clocks(data), *other_paces(data, rows, names)] if with_clocks else []
    right += [m for m in clocks if _is_far_better(m, told, CLOCK_FALLS_TO * limit)]
    if not right:
        return None
    right = _that_roll_out(right, data)
    if not right:
        return None
    left = np.array([float(np.nanmean(np.log(m.after_nm / (np.abs(m.reading.torques) * told)))) for m in right])
    same = [m for m, value in zip(right, left, strict=True) if value < left.min() + _SAME]
    return or_heavier_link(_either([or_turned_gravity(m, data) for m in same]), data, names)


def _that_roll_out(found: Sequence[Misreading], data: Sequence[ToldEpisode]) -> list[Misreading]:
    """Those with which the model goes where the robot went, and the data as they are told do not."""
    k = len(found[0].after_nm)
    told = _rollout_errors(data, Reading(np.ones(k), np.ones(k)))
    kept = []
    for each in found:
        share = _rollout_errors(data, each.reading)
        ratio, own = share / told, list(each.joints)
        most = _GOES_TO if each.reading.pace == 1.0 else 1.0  # a clock that is a few per cent off is not all that is left
        clear = [j for j in own if told[j] <= _STANDS or share[j] <= _STANDS] if _is_of_clocks(each) else own
        goes = _largest(ratio[own]) <= most and _largest(share[clear]) <= _STANDS
        if goes and np.nanmean(np.log(ratio)) < 0.0:
            kept.append(each)
    return kept


def _is_of_clocks(found: Misreading) -> bool:
    """Whether a reading is about all joints at once: one that hardly moves, and goes elsewhere either way, says nothing of it."""
    return bool(found.reading.late_s) or found.reading.pace != 1.0


def _largest(values: np.ndarray) -> float:
    """Of those that are known; infinite where none is."""
    return float(np.nanmax(values, initial=np.inf if np.isnan(values).all() else 0.0))


def _rollout_errors(data: Sequence[ToldEpisode], reading: Reading) -> np.ndarray:
    """Median over windows of how far each joint is from where it was, as a share of how far it moved, shape (k,)."""
    rows = all_rows(data, reading.positions, reading.late_s, reading.pace, reading.zeros_rad, held_out=False)
    coulomb, damping, offset = (np.zeros(len(rows)) for _ in range(3))
    for j, of_joint in enumerate(rows):
        if len(of_joint.given) >= FEWEST_ROWS:
            _, (coulomb[j], damping[j], offset[j]) = rms_left(
                reading.torques[j] * of_joint.given - of_joint.needed, of_joint.free
            )
    coulomb += data[0].coulomb_nm  # beside what was needed, which has the model's friction
    damping += data[0].episode.plant.own_values[VISCOUS_FRICTION]  # at any speed that a reading has
    damping += data[0].damping_nm_s_rad / (np.abs(reading.positions) * reading.pace)
    losses = Losses(np.maximum(coulomb, 0.0), np.maximum(damping, 0.0), -offset)
    motions, starts = zip(*(_motion(told, reading) for told in data), strict=True)
    many = max(1, round(sum(map(len, starts)) / _MOST_WINDOWS))
    errors = Rollouts(data[0].episode.plant).errors(motions, [each[::many] for each in starts], _WINDOW_S, losses)
    if not len(errors):
        return np.full(len(rows), np.nan)
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(errors).any(axis=0), np.nanmedian(errors, axis=0), np.nan)


def _motion(told: ToldEpisode, reading: Reading) -> tuple[Motion, np.ndarray]:
    """What was recorded, read so, and where the windows begin that friction was not fitted to."""
    episode, path = told.episode, told.episode.path
    torque, time_s = episode.acting_nm.T * reading.torques, path.recording.time_s
    if reading.late_s:
        torque = np.stack([np.interp(time_s + reading.late_s, time_s, column) for column in torque.T], axis=1)
    good = (episode.is_measured & ~near_end(path, episode.ends_rad)).all(axis=1)
    known = np.repeat(good, path.every)[: len(time_s)]
    held_out = is_held_out(time_s - time_s[0])
    velocity, step_s = path.fast_velocity * reading.positions * reading.pace, path.step_s / reading.pace
    noise = path.position_noise_rad * np.abs(reading.positions)
    motion = Motion(path.fast_position * reading.positions + reading.zeros_rad, velocity, torque, step_s, known, noise)
    return motion, windows_of(motion, _WINDOW_S, _WINDOW_S / 2, held_out)


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
