"""Objects of foreign data: poses at the times at which they were seen."""

import numpy as np

from sim_backend.reality_gap.measured.foreign.rows import Rows
from sim_backend.reality_gap.measured.foreign.study_channels import ObjectEntry
from sim_backend.reality_gap.recording import ObjectSignals

QUATERNION_TOLERANCE = 0.02
"""How far from 1 a quaternion's length may be: numbers that were written with two decimals are."""
_WIDTHS = {"position": 3, "quaternion": 4, "linear_velocity": 3, "angular_velocity": 3}


def object_signals(rows: Rows, entry: ObjectEntry) -> ObjectSignals:
    """The poses of one object; rows without a whole pose are left out, of poses at equal times the last counts.

    Raises:
        RecordingError: no pose at all, a quaternion that is none, times that go backwards, or arrays of other widths.
    """
    time_s, index = _times(rows, entry)
    found = {word: _array(rows, entry, word, len(time_s)) for word in _WIDTHS if _has(rows, entry, word)}
    pose = np.asarray(~np.isnan(np.column_stack([found["position"], found["quaternion"]])).any(axis=1))
    if not pose.any():
        raise rows.refusal(f"objects.{entry.name} has no row with a whole pose", entry.channels["position"][0].column)
    pose = _last_of_equal_times(time_s, pose)
    quat_wxyz = _normalised(rows, entry, found["quaternion"], pose, index)
    rotated = _rotation(quat_wxyz)
    linear, angular = found.get("linear_velocity"), found.get("angular_velocity")
    if linear is not None:
        linear = linear[pose]
        linear = np.einsum("nij,nj->ni", rotated, linear) if entry.linear_in_body else linear
    if angular is not None:
        angular = angular[pose]
        angular = angular if entry.angular_in_body else np.einsum("nji,nj->ni", rotated, angular)
    return ObjectSignals(
        name=entry.name,
        body=entry.body,
        time_s=time_s[pose],
        position_m=found["position"][pose],
        quat_wxyz=quat_wxyz,
        delivery_s=_delivery(rows, entry, pose),
        confidence=_single(rows, entry, "confidence", pose),
        linear_velocity_m_s=linear,
        angular_velocity_rad_s=angular,
    )


def _last_of_equal_times(time_s: np.ndarray, pose: np.ndarray) -> np.ndarray:
    there = np.flatnonzero(pose)
    last = np.append(np.diff(time_s[there]) > 0.0, True)
    chosen = np.zeros(len(pose), dtype=bool)
    chosen[there[last]] = True
    return chosen


def _has(rows: Rows, entry: ObjectEntry, word: str) -> bool:
    return word in entry.channels and entry.channels[word][0].key in rows.values


def _times(rows: Rows, entry: ObjectEntry) -> tuple[np.ndarray, np.ndarray]:
    """Times from the episode's begin, and the rows of the file that they stand in."""
    if not _has(rows, entry, "time"):
        return rows.time_s, rows.index
    channel = entry.channels["time"][0]
    time_s = rows.values[channel.key] - rows.start_s
    index = rows.index if len(time_s) == len(rows.index) else np.arange(len(time_s))
    seen = np.flatnonzero(np.isfinite(time_s))
    if len(seen) == 0:
        raise rows.refusal(f"{channel.key} has no value in any row", channel.column)
    backwards = np.flatnonzero(np.diff(time_s[seen]) < 0.0)
    if len(backwards):
        row = int(index[seen[backwards[0] + 1]])
        raise rows.table.refusal(f"{channel.key} goes backwards", channel.column, row)
    return time_s, index


def _array(rows: Rows, entry: ObjectEntry, word: str, count: int) -> np.ndarray:
    channel = entry.channels[word][0]
    values = rows.values[channel.key]
    if values.ndim != 2 or values.shape[1] != _WIDTHS[word]:
        width = values.shape[1] if values.ndim == 2 else 1
        raise rows.refusal(f"{channel.key} has {width} columns; it needs {_WIDTHS[word]}", channel.column)
    if len(values) != count:
        raise rows.refusal(f"{channel.key} has {len(values)} rows, but its times have {count}", channel.column)
    rows.refuse_empty(channel, values)
    if _has(rows, entry, "time"):
        values = np.where(np.isfinite(rows.values[entry.channels["time"][0].key])[:, None], values, np.nan)
    return values


def _normalised(rows: Rows, entry: ObjectEntry, quaternion: np.ndarray, pose: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Quaternions of unit length, scalar part first."""
    with np.errstate(over="ignore"):  # of a broken file anything may come; an infinite length is refused below
        length = np.linalg.norm(quaternion[pose], axis=1)
    wrong = np.flatnonzero(np.abs(length - 1.0) > QUATERNION_TOLERANCE)
    if len(wrong):
        row = int(index[np.flatnonzero(pose)[wrong[0]]])
        column = ", ".join(channel.column for channel in entry.channels["quaternion"])
        raise rows.table.refusal(
            f"the quaternion has length {length[wrong[0]]:.3g}; it must be 1 within {QUATERNION_TOLERANCE:g}. "
            "Leave the cells empty where no pose was seen",
            column,
            row,
        )
    unit = quaternion[pose] / length[:, None]
    return np.roll(unit, 1, axis=1) if entry.xyzw else unit


def _rotation(quat_wxyz: np.ndarray) -> np.ndarray:
    """Matrices from body to world, shape (n, 3, 3)."""
    w, x, y, z = quat_wxyz.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _single(rows: Rows, entry: ObjectEntry, word: str, pose: np.ndarray) -> np.ndarray | None:
    if not _has(rows, entry, word):
        return None
    channel = entry.channels[word][0]
    values = rows.values[channel.key]
    if values.shape not in {(len(pose),), (len(pose), 1)}:
        raise rows.refusal(
            f"{channel.key} has shape {values.shape}; it needs one number for each of {len(pose)} rows", channel.column
        )
    rows.refuse_empty(channel, values)
    return values.reshape(-1)[pose]


def _delivery(rows: Rows, entry: ObjectEntry, pose: np.ndarray) -> np.ndarray | None:
    delivery = _single(rows, entry, "delivery", pose)
    return None if delivery is None else delivery - rows.start_s
