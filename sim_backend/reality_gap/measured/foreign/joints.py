"""Joints of foreign data on the episode's grid."""

from collections.abc import Mapping, Sequence

import numpy as np

from sim_backend.reality_gap.measured.foreign import time_grid
from sim_backend.reality_gap.measured.foreign.data_table import find
from sim_backend.reality_gap.measured.foreign.measurement_units import chosen_factor
from sim_backend.reality_gap.measured.foreign.rows import Rows
from sim_backend.reality_gap.measured.foreign.study_file import Controller, JointEntry
from sim_backend.reality_gap.measured.outliers import position_outliers, torque_outliers
from sim_backend.reality_gap.recording import JointSignals, Outlier

_HELD = ("commanded_torque", "desired_torque")
_TORQUES = ("commanded_torque", "measured_torque")
_SLOWER = 1.5
"""A joint whose positions come so many steps of the grid apart, or more, skips some."""
_SIGNED = ("velocity", "commanded_torque", "measured_torque", "desired_torque")


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

    A joint without any torque, but with position targets, was sent what the controller makes of them.

    Raises:
        RecordingError: a channel without any value.
    """
    outliers: list[Outlier] = []
    columns = [_joint(rows, grid, joint, outliers) for joint in joints]
    for joint, column in zip(joints, columns, strict=True):
        if controller is not None and "position_target" in column and not any(word in column for word in _TORQUES):
            column["commanded_torque"] = _controlled(controller, joint.name, column, grid.step_s)
    steps_s = np.array([time_grid.own_step_s(grid, rows.time_s, rows.column(joint.channels["position"])) for joint in joints])

    def together(word: str) -> np.ndarray | None:
        if not any(word in column for column in columns):
            return None
        nothing = np.full(grid.count, np.nan)
        return np.column_stack([column.get(word, nothing) for column in columns])

    position_rad = together("position")
    assert position_rad is not None, "every joint has a position"
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
        outliers=tuple(outliers),
    )


def _joint(rows: Rows, grid: time_grid.Grid, joint: JointEntry, outliers: list[Outlier]) -> dict[str, np.ndarray]:
    """Signals of one joint by their words; samples that were left out are added to ``outliers``."""

    def without_outliers(word: str, values: np.ndarray, is_outlier: np.ndarray) -> np.ndarray:
        outliers.extend(Outlier(word.replace("_", " "), joint.name, float(t)) for t in rows.time_s[is_outlier])
        return np.where(is_outlier, np.nan, values)

    found = {word: rows.column(channel) for word, channel in joint.channels.items() if channel.key in rows.values}
    position = found.pop("position")
    turns = not joint.slide and (joint.wrapped if joint.wrapped is not None else time_grid.jumps(rows.time_s, position))
    zero = joint.zero * _factor(rows, joint, "position")
    position = joint.sign * ((time_grid.unwrapped(position) if turns else position) - zero)
    position = without_outliers("position", position, position_outliers(position))
    signals = {"position": time_grid.interpolated(grid, rows.time_s, position, own_rate=True)}
    for word in _SIGNED:
        if word in found:
            if word in _TORQUES:
                found[word] = without_outliers(word, found[word], torque_outliers(found[word]))
            signals[word] = _resampled(rows, grid, word, joint.sign * found[word])
    if "position_target" in found:
        target = time_grid.held(grid, rows.time_s, _target(joint, found["position_target"], zero, position, turns=turns))
        signals["position_target"] = target
    if "temperature" in found:
        rise = found["temperature"] - joint.ambient * _factor(rows, joint, "temperature")
        signals["temperature"] = time_grid.interpolated(grid, rows.time_s, rise, own_rate=True)
    return signals


def _controlled(controller: Controller, joint: str, column: Mapping[str, np.ndarray], step_s: float) -> np.ndarray:
    """Torque that a controller sends, N m; without a reported velocity by the slope of the position; shape (s,)."""
    position = column["position"]
    velocity = column["velocity"] if "velocity" in column else np.gradient(position, step_s)
    return controller.torque_nm(joint, column["position_target"], position, velocity, column.get("desired_torque", 0.0))


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
