"""A table of foreign data, whatever its format: named columns of numbers, and rows counted as a person counts them."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_backend.reality_gap.measured.foreign.measurement_units import Quantity, chosen_factor, header_parts
from sim_backend.reality_gap.measured.foreign.naming import listed, nearest
from sim_backend.reality_gap.recording import RecordingError

_ADDRESS = re.compile(r"^(?P<name>.+)\[(?P<column>\d+)\]$")


@dataclass(frozen=True)
class DataTable:
    """An open file of columns.

    Attributes:
        path: of the file.
        names: of the columns, stripped.
        first_row: number of the first sample's row: 2 in a CSV file, whose header is line 1, otherwise 1.
        read_numbers: columns by name as numbers, shapes (rows,) or (rows, k), NaN where a cell is empty; as datetime64 where a
            column holds dates, NaT where a cell is empty.
        read_labels: one column as text, shape (rows,).
    """

    path: Path
    names: tuple[str, ...]
    first_row: int
    read_numbers: Callable[[Sequence[str]], dict[str, np.ndarray]]
    read_labels: Callable[[str], np.ndarray]

    def refusal(self, reason: str, column: str | None = None, row: int | None = None) -> RecordingError:
        """What to raise: file, column, row and reason. ``row`` counts samples from 0."""
        place = "" if column is None else f", column {column!r}"
        place += "" if row is None else f", row {row + self.first_row}"
        return RecordingError(f"{self.path}{place}: {reason}")


@dataclass(frozen=True)
class Address:
    """Where numbers lie in a table: a column, for a two-dimensional one perhaps one column of it, and the header's unit."""

    name: str
    column: int | None
    unit: str | None


def find(table: DataTable, reference: str, key: str) -> Address:
    """Where a reference of study.toml leads: a column's full name, its name without the unit, or ``name[2]``.

    Raises:
        RecordingError: no such column; the message lists those that there are.
    """
    found = _by_name(table, reference)
    if found is not None:
        return found
    address = _ADDRESS.match(reference)
    if address is not None:
        base = _by_name(table, address["name"])
        if base is not None:
            return Address(base.name, int(address["column"]), base.unit)
    raise table.refusal(
        f"{key} asks for a column {reference!r} that is not there{nearest(reference, table.names)}; "
        f"the file has {listed(table.names)}{_headless(table.names)}"
    )


def column_of(table: DataTable, numbers: dict[str, np.ndarray], address: Address, key: str) -> np.ndarray:
    """The numbers at an address, shape (rows,), or (rows, k) for a whole two-dimensional array.

    Raises:
        RecordingError: one column asked of an array that has no such one.
    """
    values = numbers[address.name]
    if address.column is None:
        return values
    if values.ndim != 2 or address.column >= values.shape[1]:
        shape = "has one dimension" if values.ndim == 1 else f"has columns 0 to {values.shape[1] - 1}"
        raise table.refusal(f"{key} asks for column {address.column} of it, but it {shape}", address.name)
    return values[:, address.column]


def in_si_units(
    table: DataTable, values: np.ndarray, stated: str | float | None, address: Address, quantity: Quantity, key: str
) -> np.ndarray:
    """Numbers of a column in SI units; dates as seconds since 1970, so that all columns of dates are of one clock.

    Args:
        table: that they come from.
        values: of the column, any shape.
        stated: the unit that study.toml names, if any.
        address: of the column.
        quantity: what it holds.
        key: its place in study.toml.

    Raises:
        RecordingError: a unit that is none, or dates that are no time or have a unit.
    """
    if values.dtype.kind != "M":
        where = f"{table.path}, column {address.name!r} for {key}"
        return values * chosen_factor(stated, address.unit, quantity, where)
    if quantity is not Quantity.TIME:
        raise table.refusal(f"holds dates, and {key} needs numbers", address.name)
    if stated is not None:
        raise table.refusal(f"holds dates, which have no unit: leave {stated!r} out of study.toml", address.name)
    seconds = (values - np.datetime64(0, "ns")).astype("timedelta64[ns]").astype(float) * 1e-9
    return np.where(np.isnat(values), np.nan, seconds)


def refuse_infinite(table: DataTable, name: str, values: np.ndarray) -> None:
    """Raise RecordingError where a number is infinite: that is no measurement, and an empty cell would say missing."""
    infinite = np.isinf(values)
    if infinite.any():
        row = int(np.argwhere(infinite)[0][0])
        raise table.refusal("the number is infinite; leave the cell empty where nothing was measured", name, row)


def _by_name(table: DataTable, reference: str) -> Address | None:
    wanted = reference.strip()
    exact = table.names.count(wanted)
    if exact > 1:
        raise table.refusal(f"{exact} columns have this name; rename all but one", wanted)
    if exact == 1:
        return Address(wanted, None, header_parts(wanted)[1])
    without_unit = [name for name in table.names if header_parts(name)[0] == wanted]
    return Address(without_unit[0], None, header_parts(without_unit[0])[1]) if len(without_unit) == 1 else None


def _headless(names: Sequence[str]) -> str:
    try:
        [float(name) for name in names]
    except ValueError:
        return ""
    return ". These are numbers: the file seems to have no header; put the columns' names in line 1"
