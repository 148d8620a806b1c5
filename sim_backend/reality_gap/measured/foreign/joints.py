"""Joints of foreign data on the episode's grid."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.measured.foreign import time_grid
from sim_backend.reality_gap.measured.foreign.data_table import find
from sim_backend.reality_gap.measured.foreign.measurement_units import chosen_factor
from sim_backend.reality_gap.measured.foreign.rows import Rows
from sim_backend.reality_gap.measured.foreign.study_channels import JointEntry, VoltageMotor
from sim_backend.reality_gap.measured.foreign.study_model import Controller
from sim_backend.reality_gap.measured.outliers import position_outliers, torque_outliers
from sim_backend.reality_gap.measured.repeated_rows import rows_that_are_samples, without_repeats
from sim_backend.reality_gap.measured.sensor_noise import encoder_step
from sim_backend.reality_gap.recording import JointSignals, Outlier, Recording, RecordingError

_HELD = ("commanded_torque", "desired_torque", "velocity_target")
_TORQUES = ("commanded_torque", "measured_torque")
_SLOWER = 1.5
"""A joint whose positions come so many steps of the grid apart, or more, skips some."""
_UNLIKE = 0.1
"""Share of a recorded torque that a stated controller may be off, for what filters and rounding do to velocities."""
_SENSED = ("position", "velocity", "measured_torque")
"""What sensors report."""
_LATE_ROWS = range(-1, 3)
"""By which the columns of a table may lie apart."""
_SIGNED = ("velocity", "velocity_target", "commanded_torque", "measured_torque", "desired_torque")


def without_repeated_rows(rows: Rows, joints: Sequence[JointEntry]) -> Rows:
    """Rows without those that repeat the row before in all that the joints' sensors report."""
    channels = [joint.channels[word] for joint in joints for word in _SENSED if word in joint.channels]
    stay = rows_that_are_samples([rows.column(each) for each in channels if each.key in rows.values])
    return rows if stay.all() else replace(rows.where(stay), time_s=rows.time_s[stay])


def position_rows(rows: Rows, joints: Sequence[JointEntry]) -> np.ndarray:
    """Times at which any joint has a position, shape (m,)."""
    there = np.zeros(len(rows.index), dtype=bool)
    for joint in joints:
        there |= np.isfinite(rows.column(joint.channels["position"]))
    return rows.time_s[there]


def joint_signals(
    rows: Rows, grid: time_grid.Grid, joints: Sequence[JointEntry], controller: Controller | None = None
) -> JointSignals:
    """Joints on a grid: positions unwrapped, commands held, everything in the model's direction and zero.

    A joint without any torque was sent what its servo or a controller makes of position targets, or its motor of a voltage, and
    nothing if it is passive.

    Raises:
        RecordingError: a channel without any value.
    """
    outliers: list[Outlier] = []
    columns = [_joint(rows, grid, joint, outliers) for joint in joints]
    feedback = _feedback(joints, columns, controller, grid.count)
    sampled = [without_repeats(rows.column(joint.channels["position"])) for joint in joints]
    steps_s = np.array([time_grid.own_step_s(grid, rows.time_s, values) for values in sampled])

    def together(word: str) -> np.ndarray | None:
        if not any(word in column for column in columns):
            return None
        nothing = np.full(grid.count, np.nan)
        return np.column_stack([column.get(word, nothing) for column in columns])

    position_rad = together("position")
    assert position_rad is not None, "every joint has a position"
    made = list[str]()
    if feedback is not None:
        sent = feedback.torque_nm(position_rad, _velocities(columns, grid.step_s))
        for j, (joint, column) in enumerate(zip(joints, columns, strict=True)):
            if feedback.is_known[j] and not any(word in column for word in _TORQUES):
                column["commanded_torque"] = sent[:, j]
                made.append(joint.name)
    return JointSignals(
        names=tuple(joint.name for joint in joints),
        position_rad=position_rad,
        velocity_rad_s=together("velocity"),
        commanded_torque_nm=together("commanded_torque"),
        measured_torque_nm=together("measured_torque"),
        desired_torque_nm=together("desired_torque"),
        position_target_rad=together("position_target"),
        temperature_rise_k=together("temperature"),
        position_step_s=steps_s if (steps_s > _SLOWER * grid.step_s).any() else None,
        encoder_step_rad=encoder_step(np.column_stack([rows.column(joint.channels["position"]) for joint in joints])),
        outliers=tuple(outliers),
        feedback=feedback,
        not_recorded=tuple(made),
    )


def _joint(rows: Rows, grid: time_grid.Grid, joint: JointEntry, outliers: list[Outlier]) -> dict[str, np.ndarray]:
    """Signals of one joint by their words; samples that were left out are added to ``outliers``."""

    def without_outliers(word: str, values: np.ndarray, is_outlier: np.ndarray) -> np.ndarray:
        outliers.extend(Outlier(word.replace("_", " "), joint.name, float(t)) for t in rows.time_s[is_outlier])
        return np.where(is_outlier, np.nan, values)

    found = {word: rows.column(channel) for word, channel in joint.channels.items() if channel.key in rows.values}
    position = without_repeats(found.pop("position"))
    turns = not joint.slide and (joint.wrapped if joint.wrapped is not None else time_grid.jumps(rows.time_s, position))
    zero = joint.zero * _factor(rows, joint, "position")
    position = joint.sign * ((time_grid.unwrapped(position) if turns else position) - zero)
    position = without_outliers("position", position, position_outliers(position))
    signals = {"position": time_grid.interpolated(grid, rows.time_s, position, own_rate=True)}
    for word in _SIGNED:
        if word in found:
            if word in _TORQUES:
                found[word] = without_outliers(word, found[word], torque_outliers(found[word]))
            signals[word] = _resampled(rows, grid, word, joint.sign_of(word) * found[word])
    if "position_target" in found:
        target = time_grid.held(grid, rows.time_s, _target(joint, found["position_target"], zero, position, turns=turns))
        signals["position_target"] = target
    for word in (word for word in found if joint.motor is not None and word.startswith(f"{joint.motor.table}_")):
        signals[word] = time_grid.held(grid, rows.time_s, found[word])
    if joint.passive:
        signals["commanded_torque"] = np.zeros(grid.count)
    if "temperature" in found:
        rise = found["temperature"] - joint.ambient * _factor(rows, joint, "temperature")
        signals["temperature"] = time_grid.interpolated(grid, rows.time_s, rise, own_rate=True)
    return signals


def refuse_dead_torques(recordings: Sequence[Recording], place: str) -> None:
    """Refuse measured torques that are 0 in every row of a study while commanded ones are not: a driver reported none.

    Raises:
        RecordingError: of which joint.
    """
    for j, name in enumerate(recordings[0].joints.names if recordings and recordings[0].joints is not None else ()):
        acts = {}
        for word in _TORQUES:
            columns = [getattr(each.joints, f"{word}_nm") for each in recordings]
            known = np.concatenate([column[np.isfinite(column[:, j]), j] for column in columns if column is not None] or [[]])
            acts[word] = bool(known.any()) if len(known) else None
        if acts["measured_torque"] is False and acts["commanded_torque"]:
            raise RecordingError(
                f"{place}, [joints.{name}]: measured_torque is 0 in every row, while commanded_torque is not; leave "
                "the column out if nothing was reported there"
            )


def with_laws_that_hold(recordings: Sequence[Recording], joints: Sequence[JointEntry]) -> list[Recording]:
    """Recordings of a study, of which no joint has a controller's law that does not make the torque that was recorded beside it.

    Both are compared over all recordings: in one in which a joint hardly does anything they differ by noise.
    """
    errors, sizes = np.sum([_squares_off(each) for each in recordings], axis=0)
    share = np.sqrt(errors / np.maximum(sizes, 1e-30))
    unlike = {joint.name: float(share[j]) for j, joint in enumerate(joints) if joint.motor is None and share[j] > _UNLIKE}
    if not unlike:
        return list(recordings)
    gone = [joint.name in unlike for joint in joints]

    def without(each: JointSignals) -> JointSignals:
        law = None if each.feedback is None else each.feedback.without(gone)
        return replace(each, feedback=law if law is not None and law.is_known.any() else None, unlike_law=unlike)

    return [r if r.joints is None else replace(r, joints=without(r.joints)) for r in recordings]


def _squares_off(recording: Recording) -> np.ndarray:
    """Sums of squares by which recorded torques differ from a law's, and of themselves; 0 where one is unknown; shape (2, k)."""
    signals = recording.joints
    assert signals is not None, "a study of joints has them in every recording"
    found, law, velocity = np.zeros((2, len(signals.names))), signals.feedback, signals.velocity_rad_s
    if law is None:
        return found
    torques = (signals.commanded_torque_nm, signals.measured_torque_nm)
    slope = np.gradient(signals.position_rad, recording.step_s, axis=0)
    sent = law.torque_nm(signals.position_rad, slope if velocity is None else np.where(np.isfinite(velocity), velocity, slope))
    for j, name in enumerate(signals.names):
        recorded = next((each[:, j] for each in torques if each is not None and np.isfinite(each[:, j]).any()), None)
        if recorded is not None and law.is_known[j] and name not in signals.not_recorded:
            by_rows = [_paired(sent[:, j], recorded, rows) for rows in _LATE_ROWS]
            found[:, j] = min(by_rows, key=lambda each: each[0])
    return found


def _paired(sent: np.ndarray, recorded: np.ndarray, rows: int) -> tuple[float, float]:
    """Sums of squares of the difference, with the second so many rows later, and of the second."""
    early, late = (sent[: len(sent) - rows], recorded[rows:]) if rows >= 0 else (sent[-rows:], recorded[:rows])
    known = np.isfinite(early) & np.isfinite(late)
    return float(np.sum((late - early)[known] ** 2)), float(np.sum(late[known] ** 2))


def _velocities(columns: Sequence[Mapping[str, np.ndarray]], step_s: float) -> np.ndarray:
    """As reported, or where nothing is the slope of the positions, shape (s, k)."""
    return np.column_stack([column.get("velocity", np.gradient(column["position"], step_s)) for column in columns])


def _feedback(
    joints: Sequence[JointEntry], columns: Sequence[Mapping[str, np.ndarray]], controller: Controller | None, samples: int
) -> Feedback | None:
    """What turned position targets into torque; None where no joint has any."""
    laws = np.full((7, samples, len(joints)), np.nan)
    for j, (joint, column) in enumerate(zip(joints, columns, strict=True)):
        if joint.motor is not None and (joint.motor.table == "motor" or "position_target" in column):
            laws[:, :, j] = _of_motor(joint.motor, joint.sign * joint.torque_sign, column, samples)
        elif controller is not None and "position_target" in column:
            damping, nothing = controller.damping_nm_s_rad[joint.name], np.zeros(samples)
            desired = column.get("desired_torque", nothing) + damping * column.get("velocity_target", nothing)
            laws[0, :, j], laws[5, :, j] = column["position_target"], desired
            laws[1, :, j], laws[2, :, j] = controller.stiffness_nm_rad[joint.name], damping
            laws[3, :, j], laws[4, :, j] = controller.torque_limit_nm.get(joint.name, np.inf), 0.0
            laws[6, :, j] = controller.on_board
    return Feedback(*laws) if np.isfinite(laws[1]).any() else None


def _of_motor(motor: VoltageMotor, sign: float, column: Mapping[str, np.ndarray], samples: int) -> np.ndarray:
    """The law of a motor that is driven by voltage, in the order of :class:`Feedback`, shape (7, samples)."""

    def of(key: str) -> np.ndarray:
        return column.get(f"{motor.table}_{key}", np.full(samples, motor.constants.get(key, np.nan)))

    nothing, on_board, enabled = np.zeros(samples), np.ones(samples), of("enabled")
    is_on = np.where(np.isfinite(enabled), enabled > 0.5, False)
    by_volt = is_on * motor.torque_constant_nm_a / motor.resistance_ohm
    stall_nm, back_emf = by_volt * of("supply"), by_volt * motor.torque_constant_nm_a
    if motor.table == "servo":
        desired = column.get("desired_torque", nothing)
        target, stiffness = column["position_target"], stall_nm * of("gain")
        return np.stack([target, stiffness, nothing, np.abs(stall_nm), back_emf, desired, on_board])
    sent_nm = stall_nm * of("duty") if "motor_duty" in column or "duty" in motor.constants else by_volt * of("voltage")
    limit_nm = np.where(np.isfinite(stall_nm), np.abs(stall_nm), np.inf)
    return np.stack([nothing, nothing, nothing, limit_nm, back_emf, sign * sent_nm, on_board])


def _target(joint: JointEntry, target: np.ndarray, zero: float, position: np.ndarray, *, turns: bool) -> np.ndarray:
    """Position targets as the positions are counted: in the model's direction, and on the same turn where angles wrap."""
    target = joint.sign * (target - zero)
    return time_grid.on_the_turn_of(target, position) if turns else target


def _resampled(rows: Rows, grid: time_grid.Grid, word: str, values: np.ndarray) -> np.ndarray:
    if word in _HELD:
        return time_grid.held(grid, rows.time_s, values)
    return time_grid.interpolated(grid, rows.time_s, values, own_rate=True)


def _factor(rows: Rows, joint: JointEntry, word: str) -> float:
    channel = joint.channels[word]
    return chosen_factor(channel.unit, find(rows.table, channel.column, channel.key).unit, channel.quantity, channel.key)
