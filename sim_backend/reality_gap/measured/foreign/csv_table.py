"""CSV files, plain or gzipped: separators, headers and comments as they come, and the row of whatever cannot be read."""

import csv
import gzip
import io
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from sim_backend.reality_gap.measured.foreign.data_table import DataTable, refuse_infinite
from sim_backend.reality_gap.recording import RecordingError

_MISSING = ["", "NaN", "nan", "NAN", "-nan", "-NaN", "NA", "N/A", "n/a", "#N/A", "null", "NULL", "None", "none", "-", "--"]
_COMMENT = "#"
_CLOCK = re.compile(r"\d+[:/.-]\d+[:/.-]\d")
"""What looks like a time of day, or like a date that is written in another order."""


@dataclass(frozen=True)
class _Text:
    """A CSV file's bytes and how they are laid out: ``head`` lines lie above the first sample."""

    path: Path
    content: bytes
    names: tuple[str, ...]
    separator: str
    decimal_point: str
    head: int


def open_csv(path: Path) -> DataTable:
    """A CSV file; the separator is a comma, semicolon or tab, and lines that begin with ``#`` may lie above the header.

    Raises:
        RecordingError: an empty file, gzip that breaks off, or text that is not UTF-8.
    """
    text = _laid_out(path, _content(path))
    table = DataTable(path, text.names, text.head + 1, lambda names: _numbers(table, text, names), lambda name: _text(text, name))
    return table


def _content(path: Path) -> bytes:
    try:
        content = path.read_bytes()
        if path.suffix == ".gz":
            content = gzip.decompress(content)
    except (EOFError, OSError, zlib.error) as error:
        raise RecordingError(
            f"{path}: cannot be read ({error}); copy the file again, it seems to be cut off or no gzip"
        ) from error
    content = content.removeprefix(b"\xef\xbb\xbf").rstrip()
    if not content:
        raise RecordingError(f"{path}: the file is empty")
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        raise RecordingError(
            f"{path}, row {row}: byte {content[error.start]:#04x} is not UTF-8 text; save it as CSV in UTF-8"
        ) from error
    return content


def _laid_out(path: Path, content: bytes) -> _Text:
    start = content[:100_000].decode("utf-8", "ignore").split("\n")
    head = next((index for index, line in enumerate(start) if line.strip() and not line.startswith(_COMMENT)), len(start))
    if head == len(start):
        raise RecordingError(f"{path}: the file has no samples, only comments")
    header, first = start[head], start[head]
    if head > 0 and _all_numbers(first) and start[head - 1].startswith(_COMMENT):
        header, head = start[head - 1].lstrip(_COMMENT), head - 1  # as numpy.savetxt writes it
    elif len(start) > head + 1:
        first = start[head + 1]
    if content.count(b"\n") <= head:
        raise RecordingError(f"{path}: the file has no samples, only a header")
    separator = max(",;\t", key=header.count)
    names = tuple(name.strip() for name in next(csv.reader([header], delimiter=separator)))
    decimal_point = "," if separator != "," and "," in first and "." not in first else "."
    return _Text(path, content, names, separator, decimal_point, head + 1)


def _all_numbers(line: str) -> bool:
    try:
        [float(cell) for cell in line.replace(";", ",").replace("\t", ",").split(",")]
    except ValueError:
        return False
    return True


def _numbers(table: DataTable, text: _Text, names: Sequence[str]) -> dict[str, np.ndarray]:
    try:
        columns = _read(text, names, pa.float64())
    except pa.ArrowInvalid:
        columns = {name: _converted(table, text, name) for name in names}
    for name, values in columns.items():
        if values.dtype.kind != "M":
            refuse_infinite(table, name, values)
    return columns


def _read(text: _Text, names: Sequence[str], kind: pa.DataType) -> dict[str, np.ndarray]:
    positions = {name: text.names.index(name) for name in names}
    by_position = {str(position): kind for position in positions.values()}
    table = pa_csv.read_csv(
        io.BytesIO(text.content),
        pa_csv.ReadOptions(skip_rows=text.head, column_names=[str(index) for index in range(len(text.names))]),
        pa_csv.ParseOptions(delimiter=text.separator, ignore_empty_lines=False),
        pa_csv.ConvertOptions(
            column_types=by_position,
            include_columns=list(by_position),
            null_values=_MISSING if kind == pa.float64() else [],
            decimal_point=text.decimal_point,
        ),
    )
    return {name: table.column(str(position)).to_numpy() for name, position in positions.items()}


def _converted(table: DataTable, text: _Text, name: str) -> np.ndarray:
    """The slow way, cell by cell, that finds the row of what is no number; a column whose first cell is a date holds dates."""
    cells = [cell.strip() for cell in _text(text, name)]
    if _date(next((cell for cell in cells if cell not in _MISSING), "")) is not None:
        return _dates(table, cells, name)
    values = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        if cell in _MISSING:
            continue
        try:
            values[row] = float(cell.replace(text.decimal_point, ".").replace("_", "no digit"))
        except ValueError:
            instead = "; times are numbers, or dates such as 2026-11-30 09:15:00.123" if _CLOCK.match(cell) else ""
            raise table.refusal(f"{cell[:40]!r} is not a number{instead}", name, row) from None
    return values


def _dates(table: DataTable, cells: Sequence[str], name: str) -> np.ndarray:
    """Dates of one clock, shape (rows,); NaT where a cell is empty."""
    values = np.full(len(cells), np.datetime64("NaT", "ns"))
    for row, cell in enumerate(cells):
        if cell in _MISSING:
            continue
        values[row] = date = _date(cell)
        if date is None:
            raise table.refusal(f"{cell[:40]!r} is no date such as {cells[0][:40]!r}", name, row)
    return values


def _date(cell: str) -> np.datetime64 | None:
    """A date and time of day as ISO 8601 writes them, without a zone or in UTC; None if it is none."""
    try:
        float(cell)
    except ValueError:
        try:
            date = datetime.fromisoformat(cell)
        except ValueError:
            return None
        date = date if date.tzinfo is None else date.astimezone(UTC).replace(tzinfo=None)
        return np.datetime64(date, "ns")
    return None


def _text(text: _Text, name: str) -> np.ndarray:
    try:
        cells = _read(text, [name], pa.string())[name]
    except pa.ArrowInvalid as error:
        raise _ragged(text, error) from error
    return np.array(["" if cell is None else cell for cell in cells], dtype=object)


def _ragged(text: _Text, error: Exception) -> RecordingError:
    lines = io.StringIO(text.content.decode("utf-8"), newline="")
    for row, cells in enumerate(csv.reader(lines, delimiter=text.separator), 1):
        if row > text.head and cells and len(cells) != len(text.names):
            return RecordingError(
                f"{text.path}, row {row}: {len(cells)} cells where the header names {len(text.names)} columns; "
                "complete the row or take it out"
            )
    return RecordingError(f"{text.path}: cannot be read as CSV: {error}")
