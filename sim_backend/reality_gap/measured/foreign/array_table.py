"""Parquet files and npz archives as tables."""

import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from sim_backend.reality_gap.measured.foreign.data_table import DataTable, refuse_infinite
from sim_backend.reality_gap.recording import RecordingError


def open_parquet(path: Path) -> DataTable:
    """A Parquet file; a column of lists of equal length is a two-dimensional array.

    Raises:
        RecordingError: an empty or broken file.
    """
    _refuse_empty(path)
    try:
        file = pq.ParquetFile(path)
        named = {name.strip(): name for name in file.schema_arrow.names}
    except (pa.ArrowException, OSError) as error:
        raise RecordingError(f"{path}: cannot be read as Parquet ({_first_line(error)}); copy or write the file again") from error

    def read(wanted: Sequence[str]) -> dict[str, np.ndarray]:
        try:
            columns = file.read(columns=list(dict.fromkeys(named[name] for name in wanted)))
        except (pa.ArrowException, OSError) as error:
            raise RecordingError(f"{path}: cannot be read as Parquet ({_first_line(error)})") from error
        return {name: _from_arrow(table, name, columns.column(named[name])) for name in wanted}

    table = DataTable(path, tuple(named), 1, lambda w: _numbers(table, read(w)), lambda n: _labels(read([n])[n]))
    return table


def open_npz(path: Path) -> DataTable:
    """An npz archive: one- and two-dimensional arrays by name, one row for each sample.

    Raises:
        RecordingError: an empty or broken file.
    """
    _refuse_empty(path)

    def read(wanted: Sequence[str]) -> dict[str, np.ndarray]:
        return _archive(path, wanted)

    table = DataTable(path, tuple(_archive(path, None)), 1, lambda w: _numbers(table, read(w)), lambda n: _labels(read([n])[n]))
    return table


def _refuse_empty(path: Path) -> None:
    if path.stat().st_size == 0:
        raise RecordingError(f"{path}: the file is empty")


def _archive(path: Path, wanted: Sequence[str] | None) -> dict[str, np.ndarray]:
    """Arrays by name, or only the names with ``wanted`` None."""
    name = None
    try:
        with path.open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise RecordingError(f"{path}: holds a single array without a name; write an npz with numpy.savez")
            with archive:
                if wanted is None:
                    return dict.fromkeys(archive.files, np.empty(0))
                arrays = {}
                for name in wanted:
                    arrays[name] = archive[name]
                return arrays
    except RecordingError:
        raise
    except (OSError, EOFError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:  # runtime: it is encrypted
        place = "" if name is None else f", column {name!r}"
        raise RecordingError(f"{path}{place}: cannot be read as npz ({_first_line(error)})") from error


def _from_arrow(table: DataTable, name: str, column: pa.ChunkedArray) -> np.ndarray:
    kind = column.type
    if pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
        try:
            return np.stack([np.asarray(row, dtype=float) for row in column.to_pylist()])
        except (TypeError, ValueError) as error:
            raise table.refusal(f"its lists are not numbers of equal length ({_first_line(error)})", name) from error
    if pa.types.is_timestamp(kind):
        return column.cast(pa.timestamp("ns"), safe=False).to_numpy().astype("datetime64[ns]")
    return column.to_numpy()


def _numbers(table: DataTable, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: _as_numbers(table, name, values) for name, values in arrays.items()}


def _as_numbers(table: DataTable, name: str, values: np.ndarray) -> np.ndarray:
    if values.ndim not in {1, 2}:
        raise table.refusal(f"the array has {values.ndim} dimensions, shape {values.shape}; it must have 1 or 2", name)
    if values.dtype.kind == "M":
        return values.astype("datetime64[ns]")
    if values.dtype.kind not in "fiub":
        raise table.refusal(*_text_row(values, name))
    numbers = np.asarray(values, dtype=float)
    refuse_infinite(table, name, numbers)
    return numbers


def _text_row(values: np.ndarray, name: str) -> tuple[str, str, int]:
    flat = values.reshape(len(values), -1)[:, 0] if len(values) else np.array(["nothing"])
    for row, value in enumerate(flat):
        try:
            float(value)
        except (TypeError, ValueError):
            return f"{str(value)[:40]!r} is not a number", name, row
    return f"holds {values.dtype} where numbers are needed; write it as numbers", name, 0


def _labels(values: np.ndarray) -> np.ndarray:
    if values.dtype.kind == "f" and np.all(np.isnan(values) | (values == np.round(values))):
        return np.array(["" if np.isnan(value) else str(int(value)) for value in values], dtype=object)
    return np.array(["" if value is None else str(value) for value in values.tolist()], dtype=object)


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
