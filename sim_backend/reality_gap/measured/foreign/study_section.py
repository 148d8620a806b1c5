"""One table of a study.toml, read strictly: what is missing, unknown or of another kind is refused with its place."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim_backend.reality_gap.measured.foreign.naming import listed, nearest
from sim_backend.reality_gap.recording import RecordingError


@dataclass(frozen=True)
class Section:
    """One table of the file. ``name`` is as the file writes it, such as ``[joints.shoulder]``; empty for the top."""

    file: Path
    name: str
    table: Mapping[str, Any]

    def refusal(self, reason: str) -> RecordingError:
        """What to raise: the file, the table and the reason."""
        return RecordingError(f"{self.file}{', ' + self.name if self.name else ''}: {reason}")

    def only(self, *valid: str) -> None:
        """Raise RecordingError on a key that is not among the valid ones."""
        for key in self.table:
            if key not in valid:
                raise self.refusal(f"unknown key {key!r}{nearest(key, valid)}; valid are {listed(sorted(valid))}")

    def has(self, key: str) -> bool:
        """Whether the key is given."""
        return key in self.table

    def section(self, key: str, name: str) -> "Section":
        """A table within; an empty one where there is none."""
        inner = self.table.get(key, {})
        if not isinstance(inner, Mapping):
            raise self.refusal(f"{key} is {inner!r}; it must be a table, begun with {name}")
        return Section(self.file, name, inner)

    def text(self, key: str, default: str | None = None) -> str:
        """A text that is not empty; needed where there is no default."""
        value = self.table.get(key, default)
        if value is None:
            raise self.refusal(f"{key} is missing")
        if not isinstance(value, str) or (not value.strip() and value != default):
            raise self.refusal(f"{key} is {value!r}; it must be a text")
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """A text or a list of texts."""
        value = self.table.get(key, ())
        several = (value,) if isinstance(value, str) else value
        if not isinstance(several, list | tuple) or not all(isinstance(one, str) and one.strip() for one in several):
            raise self.refusal(f"{key} is {value!r}; it must be a text or a list of texts")
        return tuple(several)

    def number(self, key: str, default: float | None = None) -> float:
        """A finite number; needed where there is no default."""
        value = self.table.get(key, default)
        if value is None:
            raise self.refusal(f"{key} is missing")
        return self.finite(key, value)

    def finite(self, key: str, value: Any) -> float:
        """A value of this table that must be a finite number."""
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.refusal(f"{key} is {value!r}; it must be a number")
        return float(value)

    def choice(self, key: str, valid: Iterable[str], default: str | None = None) -> str:
        """One of several words."""
        words = tuple(valid)
        value = self.text(key, default) if default is not None or self.has(key) else None
        if value is None:
            raise self.refusal(f"{key} is missing; choose from {', '.join(words)}")
        if value not in words:
            raise self.refusal(f"{key} is {value!r}{nearest(value, words)}; choose from {', '.join(words)}")
        return value

    def flag(self, key: str) -> bool | None:
        """True, false, or None where nothing is said."""
        value = self.table.get(key)
        if value is not None and not isinstance(value, bool):
            raise self.refusal(f"{key} is {value!r}; it must be true or false")
        return value

    def unit(self, key: str) -> str | float | None:
        """A unit's name, the number of SI units that one is, or None where nothing is said."""
        value = self.table.get(key)
        if value is None or isinstance(value, str):
            return value
        return self.finite(key, value)
