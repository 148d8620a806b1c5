"""Anyone's recordings, read as a study.toml says: each episode one :class:`Recording`, or one clear refusal."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from sim_backend.reality_gap.measured.foreign import time_grid
from sim_backend.reality_gap.measured.foreign.data_files import open_table
from sim_backend.reality_gap.measured.foreign.data_table import DataTable, column_of, find, in_si_units
from sim_backend.reality_gap.measured.foreign.joints import (
    joint_signals,
    position_rows,
    refuse_dead_torques,
    with_laws_that_hold,
    without_repeated_rows,
)
from sim_backend.reality_gap.measured.foreign.naming import listed, nearest
from sim_backend.reality_gap.measured.foreign.objects import object_signals
from sim_backend.reality_gap.measured.foreign.rows import Rows
from sim_backend.reality_gap.measured.foreign.study_channels import DataChannel
from sim_backend.reality_gap.measured.foreign.study_file import RecordingEntry, StudyFile
from sim_backend.reality_gap.recording import Recording, RecordingError

MIN_DURATION_S = 0.2
"""A shorter episode is refused: one window of replay, which is at least 0.1 s long, and a start for it."""
_LEAST_ORDERED, _AS_BY_CHANCE = 50, 0.7
"""Of so many rows or more it is asked whether their positions follow each other; share of a move between any two that is none."""
_MOVES_RAD, _MOVES_M = 0.1, 0.01
"""Between its quartiles: a joint that goes less may rest, and its noise has no order."""
_MAX_GAPS = 100  # as many empty points of the grid for each sample: a clock that jumped


def read_recordings(study: StudyFile, progress: Callable[[str], None] = lambda _: None) -> list[Recording]:
    """Every episode of a study, in the order of its files.

    Args:
        study: parsed.
        progress: told the name of each file before it is read.

    Raises:
        RecordingError: the first thing that cannot be used, with file, column, row and reason.
    """
    recordings: list[Recording] = []
    for entry in study.recordings:
        progress(entry.name)
        recordings += [_recording(study, entry, rows) for rows in _episodes(study, entry)]
    names = [recording.name for recording in recordings]
    twice = next((name for name in names if names.count(name) > 1), None) if len(set(names)) < len(names) else None
    if twice is not None:
        raise RecordingError(f"{study.path}: {twice!r} is read twice; a file or an episode stands in two [[recording]] tables")
    if not study.joints:
        return recordings
    refuse_dead_torques(recordings, str(study.path))
    return with_laws_that_hold(recordings, study.joints)


def _recording(study: StudyFile, entry: RecordingEntry, rows: Rows) -> Recording:
    rows = _timed(study, rows)
    objects = tuple(object_signals(rows, found) for found in study.objects if not entry.lacks(found.channels["position"][0]))
    if not study.joints and not objects:
        raise rows.refusal("nothing is left to read: its objects are said to be missing, and there are no joints")
    rows = without_repeated_rows(rows, study.joints) if study.joints else rows
    grid = _grid(rows, position_rows(rows, study.joints) if study.joints else objects[0].time_s)
    signals = {
        channel.owner: time_grid.interpolated(grid, rows.time_s, rows.column(channel), own_rate=True)
        for channel in study.signals
        if not entry.lacks(channel)
    }
    return Recording(
        name=rows.name,
        source=str(entry.file),
        step_s=grid.step_s,
        time_s=grid.time_s,
        joints=joint_signals(rows, grid, study.joints, study.controller) if study.joints else None,
        objects=objects,
        signals=signals,
        regime=entry.regime,
    )


def _grid(rows: Rows, time_s: np.ndarray) -> time_grid.Grid:
    duration_s = float(time_s[-1] - time_s[0]) if len(time_s) else 0.0
    if duration_s < MIN_DURATION_S:
        raise rows.refusal(
            f"lasts {duration_s:.3g} s; an episode needs {MIN_DURATION_S:g} s or more (is the unit of time right?)"
        )
    grid = time_grid.grid_over(time_s)
    if grid.count > _MAX_GAPS * len(time_s):
        position = int(np.argmax(np.diff(rows.time_s))) + 1
        raise rows.refusal(
            f"time jumps by {np.diff(rows.time_s).max():.3g} s where a step is {grid.step_s:.3g} s; make two episodes of it",
            rows.time_column,
            position,
        )
    return grid


def _timed(study: StudyFile, rows: Rows) -> Rows:
    """The rows that hold anything, with times from 0 on."""
    if study.time is None:
        assert study.rate_hz is not None, "study.toml gives a column of time or a rate"
        if _is_shuffled([rows.column(j.channels["position"]) / (_MOVES_M if j.slide else _MOVES_RAD) for j in study.joints]):
            raise rows.refusal("its rows are not in the order of time: no position is nearer to that before it than to any other")
        return rows.with_time(np.arange(len(rows.index)) / study.rate_hz, "")
    column = study.time.column
    rows = rows.where(rows.filled(study.time))
    time_s = rows.values[study.time.key]
    if len(time_s) == 0:
        raise rows.refusal("has no samples")
    if np.isnan(time_s).any():
        raise rows.refusal("the row has no time", column, int(np.flatnonzero(np.isnan(time_s))[0]))
    backwards = np.flatnonzero(np.diff(time_s) < 0.0)
    if len(backwards):
        first = int(backwards[0])
        raise rows.refusal(
            f"time goes backwards, by {time_s[first] - time_s[first + 1]:.3g} s; sort the rows, or name the column that tells "
            f"episodes apart (episode){_hint(rows, study)}",
            column,
            first + 1,
        )
    return rows.with_time(time_s - time_s[0], column, start_s=float(time_s[0]))


def _is_shuffled(positions: Sequence[np.ndarray]) -> bool:
    """Whether rows follow each other as if by chance, at all joints that move; of each joint, shape (s,), 1 being some motion."""
    moves, by_chance = [], []
    for position in positions:
        known = position[np.isfinite(position)]
        if len(known) >= _LEAST_ORDERED and np.subtract(*np.quantile(known, [0.75, 0.25])) > 1.0:
            moves.append(float(np.median(np.abs(np.diff(known)))))
            by_chance.append(float(np.median(np.abs(np.diff(np.random.default_rng(0).permutation(known))))))
    return bool(moves) and all(move > _AS_BY_CHANCE * other for move, other in zip(moves, by_chance, strict=True))


def _hint(rows: Rows, study: StudyFile) -> str:
    asked = next((entry.episode for entry in study.recordings if entry.file == rows.table.path and entry.episode), "")
    return f": there is no column {asked!r}{nearest(asked, rows.table.names)}" if asked else ""


def _episodes(study: StudyFile, entry: RecordingEntry) -> Iterator[Rows]:
    """The rows of each episode of a file."""
    table = open_table(entry.file)
    values = _values(table, list(study.channels(entry)))
    lengths = {len(columns) for columns in values.values()}
    column = entry.episode_column or (entry.episode if entry.episode in table.names else "")
    if column and len(lengths) > 1:
        raise table.refusal(f"columns of {listed(sorted(map(str, lengths)))} rows cannot be split by one episode column", column)
    reference = study.time.key if study.time is not None else next(iter(values))
    whole = Rows(entry.name, table, np.arange(len(values[reference])), values)
    if not column:
        yield whole if not entry.episode else whole.named(f"{entry.name}, {entry.episode}")
        return
    for label, index in _labelled(table, find(table, column, "episode").name, entry.episodes):
        yield whole.where(index).named(f"{entry.name}, {column} {label}")


def _values(table: DataTable, channels: Sequence[DataChannel]) -> dict[str, np.ndarray]:
    """Columns in SI units by the channels' keys; a channel of several columns has shape (rows, k)."""
    addresses = [find(table, channel.column, channel.key) for channel in channels]
    numbers = table.read_numbers(list(dict.fromkeys(address.name for address in addresses)))
    gathered: dict[str, list[np.ndarray]] = {}
    for channel, address in zip(channels, addresses, strict=True):
        values = column_of(table, numbers, address, channel.key)
        gathered.setdefault(channel.key, []).append(
            in_si_units(table, values, channel.unit, address, channel.quantity, channel.key)
        )
    lengths = {key: {len(column) for column in columns} for key, columns in gathered.items()}
    for key, found in lengths.items():
        if len(found) > 1:
            raise table.refusal(f"the columns of {key} have {listed(sorted(map(str, found)))} rows")
    return {key: columns[0] if len(columns) == 1 else np.column_stack(columns) for key, columns in gathered.items()}


def _labelled(table: DataTable, column: str, wanted: Sequence[str]) -> Iterator[tuple[str, np.ndarray]]:
    """Rows of each episode, by label in the order in which they first come."""
    labels = table.read_labels(column)
    empty = np.flatnonzero(labels == "")
    if len(empty):
        raise table.refusal("the row belongs to no episode", column, int(empty[0]))
    found, first, inverse = np.unique(labels.astype(str), return_index=True, return_inverse=True)
    for label in wanted:
        if label not in found:
            raise table.refusal(f"there is no episode {label!r}{nearest(label, found.tolist())}", column)
    order = np.argsort(inverse, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(inverse))[:-1])
    for position in np.argsort(first):
        if not wanted or found[position] in wanted:
            yield str(found[position]), groups[position]
