"""The extended model: the nominal robot with the causes that a study accepted, as a file that ``sim_backend`` loads by name.

The file is TOML as :func:`sim_backend.effects.ranges.load_ranges` reads it, so that robots (``trifarm up --physics FILE``),
training and evaluation can run on it. It holds the values, with the bits that the study found, where they come from and the
90 % interval of each, which training draws robots from.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.effects.estimate import DataFile, Draw, Estimate, Interval, Provenance, place_index
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.reality_gap.verdict import Cause

CODE = "trifarm"
"""Name of the package whose version a file states."""


@dataclass(frozen=True)
class ExtendedModel:
    """Physics of one robot (n = 1) and what a study says of it."""

    physics: Physics
    estimate: Estimate
    about: str = ""

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The values with their intervals, one for each place that the study estimated."""
        return tuple(self._cause(interval) for interval in self.estimate.intervals)

    def _cause(self, interval: Interval) -> Cause:
        effect, _, name = interval.key.partition(".")
        index = place_index(interval.parameter, interval.where)
        value = float(self.physics.value(interval.key).reshape(-1)[index or 0])
        return Cause(effect, name, interval.where, value, interval.parameter.unit, (interval.low, interval.high))


def extended_model(
    causes: Iterable[Cause], provenance: Provenance | None, *, nominal: Physics | None = None, about: str = ""
) -> ExtendedModel:
    """The model that the causes make of the nominal one.

    Args:
        causes: accepted values; each is absolute, as the catalogue defines its parameter. Places of a joint's parameter are
            names of joints or ``all joints``, of a camera's names of cameras or ``camera``, of an axis's ``x``, ``y``, ``z``.
        provenance: where they come from.
        nominal: physics of one robot that the study started from; no effect if None.
        about: a sentence for people.

    Raises:
        ValueError: an unknown effect, parameter or place, or a value that the catalogue does not allow.
    """
    causes = tuple(causes)
    intervals = tuple(Interval(_key(cause), cause.where, *map(float, cause.interval_90)) for cause in causes)
    physics = physics_of(causes, nominal)
    return ExtendedModel(physics, Estimate(provenance, intervals), about)


def physics_of(causes: Iterable[Cause], nominal: Physics | None = None) -> Physics:
    """Physics of one robot (n = 1) with the causes' values, on top of ``nominal``; errors as for :func:`extended_model`."""
    base = nominal or Physics.nominal()
    values: dict[str, np.ndarray] = {}
    for cause in causes:
        key = _key(cause)
        parameter = PARAMETERS[key]
        index = place_index(parameter, cause.where)
        array = values.setdefault(key, base.value(key).copy())
        if index is None:
            array[:] = cause.value
        else:
            array[:, index] = cause.value
    return base.changed(values)


def _key(cause: Cause) -> str:
    key = f"{cause.effect}.{cause.parameter}"
    if key in PARAMETERS:
        return key
    if cause.effect not in CATALOGUE:
        raise ValueError(f"unknown effect {cause.effect!r}; choose from {', '.join(CATALOGUE)}")
    names = ", ".join(parameter.name for parameter in CATALOGUE[cause.effect].all_parameters)
    raise ValueError(f"effect {cause.effect} has no parameter {cause.parameter!r}; choose from {names}")


def provenance_of(title: str, verdict: str, files: Sequence[Path], *, now: datetime | None = None) -> Provenance:
    """Where values come from that were fitted to some files: their digests, this code's version and the time."""
    created = (now or datetime.now(UTC)).isoformat(timespec="seconds")
    data = tuple(DataFile(file.name, hashlib.sha256(file.read_bytes()).hexdigest()) for file in files)
    return Provenance(title, created, f"{CODE} {version(CODE)}", verdict, data)


def load_extended_model(path: str | Path) -> ExtendedModel:
    """What :func:`write_extended_model` wrote, bit for bit.

    Raises:
        ValueError: as for ``load_ranges``; or the file has ranges, which are no model of one robot.
    """
    ranges = load_ranges(path)
    if ranges.rows:
        raise ValueError(f"{path} has ranges, so that it is not the model of one robot; use load_ranges")
    return ExtendedModel(ranges.shared, ranges.estimate, ranges.about)


def write_extended_model(model: ExtendedModel, path: Path) -> None:
    """Write a model to be loaded by its path."""
    path.write_text(toml(model), encoding="utf-8")


def toml(model: ExtendedModel) -> str:
    """A model as the text of its file."""
    estimate, lines = model.estimate, []
    if model.about:
        lines.append(f"about = {_text(model.about)}")
    if estimate.draws is not Draw.VALUE:
        lines.append(f"draw = {_text(estimate.draws)}")
    for effect, parameters in model.physics.document().items():
        lines += ["", f"[{effect}]", *(f"{name} = {_numbers(value)}" for name, value in parameters.items())]
    if estimate.provenance is not None:
        said = estimate.provenance
        plain = {"title": said.title, "created": said.created, "code": said.code, "verdict": said.verdict}
        lines += ["", "[provenance]", *_rows(plain)]
        for entry in said.data:
            lines += ["", "[[provenance.data]]", *_rows({"file": entry.file, "sha256": entry.sha256})]
    for interval in estimate.intervals:
        place = {"where": interval.where} if interval.where else {}
        lines += ["", "[[interval_90]]", *_rows({"key": interval.key, **place})]
        lines += [f"low = {_numbers(interval.low)}", f"high = {_numbers(interval.high)}"]
    return "\n".join(lines).lstrip("\n") + "\n"


def _rows(values: Mapping[str, str]) -> list[str]:
    return [f"{name} = {_text(value)}" for name, value in values.items()]


def _text(value: str) -> str:
    """A TOML string: JSON's escapes are TOML's, but for the one character that JSON leaves as it is."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _numbers(value: float | list[float]) -> str:
    """Numbers in their shortest form that reads back to the same bits."""
    return f"[{', '.join(map(repr, value))}]" if isinstance(value, list) else repr(float(value))
