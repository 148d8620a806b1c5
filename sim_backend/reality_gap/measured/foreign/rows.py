"""The rows of one episode of a file, in SI units, that know where they came from."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sim_backend.reality_gap.measured.foreign.data_table import DataTable
from sim_backend.reality_gap.measured.foreign.study_channels import DataChannel
from sim_backend.reality_gap.recording import RecordingError


@dataclass(frozen=True)
class Rows:
    """Rows of one episode.

    Attributes:
        name: of the episode.
        table: file that they come from.
        index: rows of the file, shape (s,), counted from 0.
        values: by the keys of the channels, shape (s,) or (s, k); objects with a time of their own may have other lengths.
        time_s: from the episode's begin, shape (s,).
        time_column: for messages; empty if the times follow from a rate.
        start_s: what the file's clock said at the begin.
    """

    name: str
    table: DataTable
    index: np.ndarray
    values: Mapping[str, np.ndarray]
    time_s: np.ndarray = field(default_factory=lambda: np.empty(0))
    time_column: str = ""
    start_s: float = 0.0

    def column(self, channel: DataChannel) -> np.ndarray:
        """A channel with one number for each row.

        Raises:
            RecordingError: an array of several columns, another number of rows, or nothing but missing values.
        """
        values = self.values[channel.key]
        if values.ndim == 2:
            if values.shape[1] != 1:
                raise self.refusal(
                    f"{channel.key} is an array of {values.shape[1]} columns; name one of them as {channel.column}[0]",
                    channel.column,
                )
            values = values[:, 0]
        if len(values) != len(self.index):
            raise self.refusal(f"{channel.key} has {len(values)} rows, but the times have {len(self.index)}", channel.column)
        self.refuse_empty(channel, values)
        return values

    def refuse_empty(self, channel: DataChannel, values: np.ndarray) -> None:
        """Raise RecordingError if a channel holds nothing but missing values."""
        if not np.isfinite(values).any():
            raise self.refusal(
                f"{channel.key} has no value in any row; if this file lacks it, say so with missing in [[recording]]",
                channel.column,
            )

    def filled(self, time: DataChannel) -> np.ndarray:
        """Which rows hold a time or any other number, shape (s,)."""
        filled = np.zeros(len(self.index), dtype=bool)
        for values in self.values.values():
            if len(values) == len(filled):
                filled |= np.isfinite(values.reshape(len(values), -1)).any(axis=1)
        return filled if time.key in self.values else np.ones(len(self.index), dtype=bool)

    def where(self, chosen: np.ndarray) -> "Rows":
        """Some of the rows, by index or by a mask."""
        count = len(self.index)
        values = {key: column[chosen] if len(column) == count else column for key, column in self.values.items()}
        return replace(self, index=self.index[chosen], values=values)

    def named(self, name: str) -> "Rows":
        """The same rows under another name."""
        return replace(self, name=name)

    def with_time(self, time_s: np.ndarray, column: str, start_s: float = 0.0) -> "Rows":
        """The same rows with times from the episode's begin."""
        return replace(self, time_s=time_s, time_column=column, start_s=start_s)

    def refusal(self, reason: str, column: str | None = None, position: int | None = None) -> RecordingError:
        """What to raise; ``position`` counts the rows of this episode from 0."""
        row = None if position is None else int(self.index[position])
        return self.table.refusal(f"{self.name}: {reason}" if column is None else reason, column or None, row)
