"""A study.toml, parsed and checked: which model, which recordings, which column holds what, in which unit.

Its tables are read strictly by ``study_section``; ``study_channels`` has what they say of columns, ``study_model`` what they say
of the model, and this file which recordings there are, and the study as a whole.
"""

import hashlib
import os.path
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mujoco import MjModel

from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance
from sim_backend.reality_gap.measured.foreign.data_files import SUFFIXES
from sim_backend.reality_gap.measured.foreign.measurement_units import Quantity, si_factor
from sim_backend.reality_gap.measured.foreign.naming import listed, nearest
from sim_backend.reality_gap.measured.foreign.study_channels import (
    DataChannel,
    JointEntry,
    ObjectEntry,
    hinge_and_slide_joints,
    joint_entries,
    object_entries,
    signal_entries,
)
from sim_backend.reality_gap.measured.foreign.study_model import (
    Controller,
    NominalValue,
    controller,
    nominal_values,
    refuse_linkages,
    tolerance,
)
from sim_backend.reality_gap.measured.foreign.study_section import Section
from sim_backend.reality_gap.recording import RecordingError

_KEYS = ("title", "data", "model", "nominal", "tolerance", "recording", "time", "joints", "objects", "signals", "controller")
_KEPT_ONLY = ("linear_velocity", "angular_velocity", "delivery", "confidence")
_RECORDING_KEYS = ("file", "episode", "episode_column", "regime", "missing")


@dataclass(frozen=True)
class RecordingEntry:
    """One file of recordings.

    Attributes:
        file: where it lies.
        name: of the file within the study, without its suffix.
        episode: a column that tells episodes apart, or a name for the only one; empty for neither.
        episode_column: the column, where ``episodes`` selects some of its values.
        episodes: the selected values as text; all where there are none.
        regime: what the episodes were recorded under.
        missing: channels that this file does not have, by their names or ``NAME.channel``.
    """

    file: Path
    name: str
    episode: str = ""
    episode_column: str = ""
    episodes: tuple[str, ...] = ()
    regime: str = ""
    missing: tuple[str, ...] = ()

    def lacks(self, channel: DataChannel) -> bool:
        """Whether the channel is said to be missing in this file."""
        of_all = (channel.word,) if channel.kind == "joints" else (channel.owner,)
        return any(name in self.missing for name in (*of_all, f"{channel.owner}.{channel.word}"))


@dataclass(frozen=True)
class StudyFile:
    """What a study.toml says.

    Attributes:
        path: of the file.
        title: of the study.
        model: the MJCF.
        nominal: values to start from, by "effect.parameter"; a joint's parameter may be a table by joint.
        tolerance: by how much the model may be off.
        recordings: one for each file, patterns already spelled out.
        time: the column of time; None with ``rate_hz``.
        rate_hz: of the samples where no column tells the time.
        joints: in the model's order.
        objects: as in the file.
        signals: other channels.
        controller: what turned position targets into torque, None if nothing is stated.
    """

    path: Path
    title: str
    model: Path
    nominal: Mapping[str, NominalValue]
    tolerance: Tolerance
    recordings: tuple[RecordingEntry, ...]
    time: DataChannel | None
    rate_hz: float | None
    joints: tuple[JointEntry, ...]
    objects: tuple[ObjectEntry, ...]
    signals: tuple[DataChannel, ...]
    controller: Controller | None

    @property
    def on_board(self) -> tuple[str, ...]:
        """Joints whose motor is driven by a law that runs beside it, so that a delay is one of targets or voltages."""
        by_controller = self.controller is not None and self.controller.on_board
        return tuple(j.name for j in self.joints if j.motor is not None or (by_controller and "position_target" in j.channels))

    @property
    def kept_only(self) -> tuple[str, ...]:
        """Channels that are read and by which no cause is judged: signals, and of objects all but their poses."""
        of_objects = [c[0].key.partition(".")[2] for o in self.objects for word, c in o.channels.items() if word in _KEPT_ONLY]
        return (*of_objects, *(signal.owner for signal in self.signals))

    def compile_model(self) -> MjModel:
        """The MJCF as a model."""
        return _compiled(self.model)

    def digests(self) -> list[dict[str, str]]:
        """SHA-256 of study.toml, model and every data file, each once: ``{"file": name, "sha256": hex}``."""
        files = dict.fromkeys([self.path, self.model, *(entry.file for entry in self.recordings)])
        return [{"file": str(path), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()} for path in files]

    def channels(self, entry: RecordingEntry) -> Iterator[DataChannel]:
        """Every channel that a file must have."""
        yield from [] if self.time is None else [self.time]
        for joint in self.joints:
            yield from (channel for channel in joint.channels.values() if not entry.lacks(channel))
        for channels in (channels for found in self.objects for channels in found.channels.values()):
            yield from (channel for channel in channels if not entry.lacks(channel))
        yield from (channel for channel in self.signals if not entry.lacks(channel))


def load_study_file(path: Path, data_root: Path | None = None) -> StudyFile:
    """Parse and check a study.toml; data files are looked for, but not yet read.

    Args:
        path: of the study.toml.
        data_root: folder that the names of data files are relative to; otherwise the file's key ``data``, or its own folder.

    Raises:
        RecordingError: anything that cannot be used, with the place and what would be valid.
    """
    top = Section(path, "", _document(path))
    top.only(*_KEYS)
    model_path = path.parent / top.text("model")
    model = _compiled(model_path)
    root = data_root if data_root is not None else path.parent / top.text("data", ".")
    time, rate_hz = _time(top)
    joints = joint_entries(top, model)
    objects = object_entries(top, model, None if time is None else time.unit)
    signals = signal_entries(top)
    if not joints and not objects:
        raise top.refusal("nothing was measured: give at least one [joints.NAME] or [objects.NAME]")
    names = tuple(hinge_and_slide_joints(model))
    study = StudyFile(
        path=path,
        title=top.text("title", path.parent.resolve().name),
        model=model_path,
        nominal=nominal_values(top, names),
        tolerance=tolerance(top),
        recordings=_recordings(top, root),
        time=time,
        rate_hz=rate_hz,
        joints=joints,
        objects=objects,
        signals=signals,
        controller=controller(top, names),
    )
    refuse_linkages(top, model, [joint.name for joint in joints])
    _refuse_unstated_controller(top, study)
    _refuse_unknown_missing(top, study)
    return study


def _document(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8"))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: byte {error.start} is not UTF-8 text; save the file as UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise RecordingError(f"{path}: no valid TOML: {error}") from error


def _compiled(path: Path) -> MjModel:
    if not path.is_file():
        raise RecordingError(f"{path}: the model does not exist; model names an MJCF file relative to study.toml")
    try:
        return MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise RecordingError(f"{path}: MuJoCo does not compile it: {' '.join(str(error).split())}") from error


def _time(top: Section) -> tuple[DataChannel | None, float | None]:
    """Column or rate; a text in the place of the table is a column in the unit of the file's header, or seconds."""
    short = {"column": top.table["time"]} if isinstance(top.table.get("time"), str) else None
    section = top.section("time", "[time]") if short is None else Section(top.file, "[time]", short)
    section.only("column", "unit", "rate_hz")
    if section.has("rate_hz") == section.has("column"):
        raise section.refusal("give either column, the column of time, or rate_hz for samples without one")
    unit = section.unit("unit")
    if unit is not None:
        si_factor(unit, Quantity.TIME, f"{section.file}, [time], unit")
    if section.has("column"):
        return DataChannel("time", "", "column", section.text("column"), Quantity.TIME, unit), None
    rate_hz = section.number("rate_hz")
    if rate_hz <= 0.0:
        raise section.refusal(f"rate_hz is {rate_hz:g}; it must be above 0")
    return None, rate_hz


def _recordings(top: Section, root: Path) -> tuple[RecordingEntry, ...]:
    tables = top.table.get("recording", [])
    if not isinstance(tables, list) or not tables or not all(isinstance(table, Mapping) for table in tables):
        raise top.refusal("no recordings; give at least one table begun with [[recording]]")
    found = [
        (file, Section(top.file, f"[[recording]] {number}", table))
        for number, table in enumerate(tables, 1)
        for file in _files(Section(top.file, f"[[recording]] {number}", table), root)
    ]
    stems = [_stem(file) for file in dict.fromkeys(file for file, _ in found)]
    return tuple(
        _recording(section, file, _stem(file) if stems.count(_stem(file)) == 1 else _longer_name(file, root))
        for file, section in found
    )


def _files(section: Section, root: Path) -> list[Path]:
    section.only(*_RECORDING_KEYS)
    name = section.text("file")
    pattern = Path(name)
    base, relative = (Path(pattern.anchor), str(pattern.relative_to(pattern.anchor))) if pattern.anchor else (root, name)
    base = Path(os.path.normpath(base))
    exact = base / relative
    files = [exact] if exact.is_file() else sorted(path for path in base.glob(relative) if path.is_file())
    if not files:
        raise section.refusal(f"file {name!r} is not in {base.resolve()}{_near_file(exact)}; the folder can be given with --data")
    for file in files:
        if not file.name.lower().endswith(SUFFIXES):
            raise section.refusal(f"{file} is of no known format; readable are {', '.join(SUFFIXES)}")
    return files


def _near_file(path: Path) -> str:
    return nearest(path.name, [other.name for other in path.parent.iterdir()]) if path.parent.is_dir() else ""


def _recording(section: Section, file: Path, name: str) -> RecordingEntry:
    episode, column = section.table.get("episode", ""), section.text("episode_column", "")
    values = episode if isinstance(episode, list) else [episode]
    if not all(isinstance(value, str | int) and not isinstance(value, bool) for value in values):
        raise section.refusal(f"episode is {episode!r}; it must be a column, a name, or with episode_column values of it")
    if not column and not isinstance(episode, str):
        raise section.refusal(f"episode is {episode!r}; to select values, name the column with episode_column")
    episodes = tuple(str(value) for value in values if column and value != "")
    return RecordingEntry(
        file, name, "" if column else str(episode), column, episodes, section.text("regime", ""), section.texts("missing")
    )


def _stem(file: Path) -> str:
    suffix = next(suffix for suffix in SUFFIXES if file.name.lower().endswith(suffix))
    return file.name[: -len(suffix)]


def _longer_name(file: Path, root: Path) -> str:
    folder = file.parent.relative_to(root) if file.is_relative_to(root) else file.parent
    return str(folder / file.name)


def _refuse_unstated_controller(top: Section, study: StudyFile) -> None:
    for joint in study.joints:
        if "velocity_target" in joint.channels and ("position_target" not in joint.channels or joint.motor is not None):
            raise top.refusal(
                f"[joints.{joint.name}] has a velocity_target, which is part of [controller] beside a position_target; where "
                "velocities alone are controlled, state stiffness 0 and name the position's column as position_target, too"
            )
        if (
            "position_target" in joint.channels
            and joint.motor is None
            and (
                study.controller is None
                or joint.name not in study.controller.stiffness_nm_rad
                or joint.name not in study.controller.damping_nm_s_rad
            )
        ):
            raise top.refusal(
                f"[joints.{joint.name}] has a position_target, but no [controller] says what became of it; "
                "state its kind, and stiffness and damping of this joint, give the joint a servo, or leave the column out"
            )


def _refuse_unknown_missing(top: Section, study: StudyFile) -> None:
    optional = [channel for joint in study.joints for word, channel in joint.channels.items() if word != "position"]
    optional += [channel for found in study.objects for channels in found.channels.values() for channel in channels]
    optional += study.signals
    valid = sorted({part for channel in optional for part in _names(channel)})
    for entry in study.recordings:
        for name in entry.missing:
            if name not in valid:
                raise top.refusal(f"missing names {name!r}{nearest(name, valid)}; valid are {listed(valid)}")


def _names(channel: DataChannel) -> tuple[str, ...]:
    if channel.kind == "signals":
        return (channel.owner,)
    if channel.kind == "objects":
        return (channel.owner,) if channel.word in {"position", "quaternion"} else (f"{channel.owner}.{channel.word}",)
    return (channel.word, f"{channel.owner}.{channel.word}")
