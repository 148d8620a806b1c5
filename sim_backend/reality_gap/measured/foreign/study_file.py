"""A study.toml, parsed and checked: which model, which recordings, which column holds what, in which unit.

From the bottom up: tables read strictly (``Section``), what they say of joints, objects and signals, what they say of the model
(values that effects start from, and the controller), and the file as a whole (``StudyFile``).
"""

import hashlib
import math
import os.path
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mujoco import MjModel, mjtJoint

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.effects.effect import Parameter, Scope
from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance
from sim_backend.reality_gap.measured.foreign.data_files import SUFFIXES
from sim_backend.reality_gap.measured.foreign.measurement_units import Quantity, si_factor
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


_HINGE = {
    "position": Quantity.ANGLE,
    "velocity": Quantity.ANGULAR_VELOCITY,
    "commanded_torque": Quantity.TORQUE,
    "measured_torque": Quantity.TORQUE,
    "desired_torque": Quantity.TORQUE,
    "position_target": Quantity.ANGLE,
    "temperature": Quantity.TEMPERATURE,
}
_SERVO = ("gain", "supply", "enabled")
"""What a servo's table may have as a number or as a column."""
_SLIDE = {Quantity.ANGLE: Quantity.LENGTH, Quantity.ANGULAR_VELOCITY: Quantity.VELOCITY, Quantity.TORQUE: Quantity.FORCE}
JOINT_CHANNELS = tuple(_HINGE)
_UNIT_KEYS = {
    "position": "position_unit",
    "position_target": "position_unit",
    "velocity": "velocity_unit",
    "commanded_torque": "torque_unit",
    "measured_torque": "torque_unit",
    "desired_torque": "torque_unit",
    "temperature": "temperature_unit",
}
_KINDS = {"commanded": "commanded_torque", "measured": "measured_torque"}


@dataclass(frozen=True)
class DataChannel:
    """A column and what it holds.

    Attributes:
        kind: ``time``, ``joints``, ``objects`` or ``signals``: the table of study.toml.
        owner: name of the joint, object or signal.
        word: what of it, such as ``velocity``; empty for a signal.
        column: as study.toml names it.
        quantity: what it holds.
        unit: None leaves it to the file's header, or SI.
    """

    kind: str
    owner: str
    word: str
    column: str
    quantity: Quantity
    unit: str | float | None = None

    @property
    def key(self) -> str:
        """Its place in study.toml."""
        return ".".join(part for part in (self.kind, self.owner, self.word) if part)


@dataclass(frozen=True)
class Servo:
    """A servo that drives its motor by voltage: duty = clip(gain (target - position), -1, 1), voltage = duty supply.

    Attributes:
        constants: ``gain`` (duty for a radian), ``supply`` (V) and ``enabled`` as far as they are numbers.
        torque_constant_nm_a: of the motor, on the joint's side.
        resistance_ohm: of its windings.
    """

    constants: Mapping[str, float]
    torque_constant_nm_a: float
    resistance_ohm: float


@dataclass(frozen=True)
class JointEntry:
    """One joint of the model.

    Attributes:
        name: in the MJCF.
        slide: whether it slides; its units are m, m/s and N then.
        channels: by the words of ``JOINT_CHANNELS``; position is always there.
        sign: -1 where the data count the other way round.
        zero: reading at which the model's joint is at 0, in the unit of the position column.
        ambient: temperature around the motor, in the unit of the temperature column.
        wrapped: whether angles jump by a turn; None leaves it to the data.
        servo: what turns its position target into torque, None where ``[controller]`` does or nothing is known.
    """

    name: str
    slide: bool
    channels: Mapping[str, DataChannel]
    sign: float = 1.0
    zero: float = 0.0
    ambient: float = 0.0
    wrapped: bool | None = None
    servo: Servo | None = None


@dataclass(frozen=True)
class ObjectEntry:
    """One object whose pose was measured.

    Attributes:
        name: of the object.
        body: of the MJCF.
        channels: ``position``, ``quaternion`` and perhaps ``linear_velocity``, ``angular_velocity``, ``delivery``,
            ``confidence``, ``time``; each one array, or a column for each component.
        xyzw: whether the scalar part of the quaternion comes last.
        linear_in_body: whether the linear velocity is given in the body's frame.
        angular_in_body: whether the angular velocity is.
    """

    name: str
    body: str
    channels: Mapping[str, tuple[DataChannel, ...]]
    xyzw: bool
    linear_in_body: bool = False
    angular_in_body: bool = True


def joint_entries(top: Section, model: MjModel) -> tuple[JointEntry, ...]:
    """The joints of ``[joints]`` in the model's order.

    Raises:
        RecordingError: a joint that the model does not have, or what :class:`Section` refuses.
    """
    tables = top.section("joints", "[joints]")
    valid = hinge_and_slide_joints(model)
    entries = {}
    for name in tables.table:
        if name not in valid:
            raise tables.refusal(
                f"the model has no hinge or slide joint {name!r}{nearest(name, valid)}; it has {listed(list(valid))} "
                "(what moves freely is an object, [objects.NAME])"
            )
        entries[name] = _joint(tables.section(name, f"[joints.{name}]"), name, slide=valid[name])
    return tuple(entries[name] for name in valid if name in entries)


def hinge_and_slide_joints(model: MjModel) -> dict[str, bool]:
    """Names of the joints with one coordinate, in order; True for those that slide."""
    kinds = {int(mjtJoint.mjJNT_HINGE): False, int(mjtJoint.mjJNT_SLIDE): True}
    return {model.joint(i).name: kinds[int(model.jnt_type[i])] for i in range(model.njnt) if int(model.jnt_type[i]) in kinds}


def _joint(section: Section, name: str, *, slide: bool) -> JointEntry:
    section.only(*JOINT_CHANNELS, "torque", "torque_kind", *_UNIT_KEYS.values(), "sign", "zero", "ambient", "wrapped", "servo")
    section.text("position")
    columns = {word: section.text(word) for word in JOINT_CHANNELS if section.has(word)} | _torque(section)
    channels = {word: _joint_channel(section, name, word, column, slide=slide) for word, column in columns.items()}
    sign = section.number("sign", 1.0)
    if sign not in {-1.0, 1.0}:
        raise section.refusal(f"sign is {sign:g}; it must be 1 or -1 (a scale belongs into the unit)")
    if section.has("temperature") and not section.has("ambient"):
        raise section.refusal("temperature needs ambient, the temperature around the motor in the same unit (0 if it is a rise)")
    servo, columns_of_servo = _servo(section, name)
    return JointEntry(
        name,
        slide,
        channels | columns_of_servo,
        sign,
        section.number("zero", 0.0),
        section.number("ambient", 0.0),
        section.flag("wrapped"),
        servo,
    )


def _servo(joint: Section, name: str) -> tuple[Servo | None, dict[str, DataChannel]]:
    """The servo of a joint, and what it reads from columns; gains and supplies may be numbers or columns."""
    if not joint.has("servo"):
        return None, {}
    section = joint.section("servo", f"[joints.{name}.servo]")
    section.only(*_SERVO, "kt", "resistance")
    if not joint.has("position_target"):
        raise section.refusal("a servo needs position_target, the column of what the joint was to be at")
    constants, channels = {"enabled": 1.0}, {}
    for key in _SERVO:
        value = section.table.get(key)
        if isinstance(value, Mapping):
            column = section.section(key, f"[joints.{name}.servo] {key}")
            column.only("column", "unit")
            channels[f"servo_{key}"] = DataChannel(
                "joints", name, f"servo_{key}", column.text("column"), Quantity.ANY, column.unit("unit")
            )
        elif isinstance(value, str):
            channels[f"servo_{key}"] = DataChannel("joints", name, f"servo_{key}", section.text(key), Quantity.ANY)
        elif value is not None or key not in constants:
            constants[key] = section.number(key)
    found = Servo(constants, section.number("kt"), section.number("resistance"))
    if not (found.torque_constant_nm_a > 0.0 and found.resistance_ohm > 0.0):
        raise section.refusal("kt and resistance must be above 0")
    return found, channels


def _joint_channel(section: Section, name: str, word: str, column: str, *, slide: bool) -> DataChannel:
    quantity = _SLIDE.get(_HINGE[word], _HINGE[word]) if slide else _HINGE[word]
    channel = DataChannel("joints", name, word, column, quantity, section.unit(_UNIT_KEYS[word]))
    if channel.unit is not None:
        si_factor(channel.unit, quantity, f"{section.file}, {section.name}, {_UNIT_KEYS[word]}")
    return channel


def _torque(section: Section) -> dict[str, str]:
    """The channel that ``torque`` with its ``torque_kind`` means."""
    if not section.has("torque"):
        if section.has("torque_kind"):
            raise section.refusal("torque_kind is given, but torque is missing")
        return {}
    word = _KINDS[section.choice("torque_kind", _KINDS)]
    if section.has(word):
        raise section.refusal(f"torque with torque_kind says the same as {word}; give one of them")
    return {word: section.text("torque")}


_OBJECT_CHANNELS = {
    "position": (3, Quantity.LENGTH, "position_unit"),
    "quaternion": (4, Quantity.NUMBER, None),
    "linear_velocity": (3, Quantity.VELOCITY, "linear_velocity_unit"),
    "angular_velocity": (3, Quantity.ANGULAR_VELOCITY, "angular_velocity_unit"),
    "delivery": (1, Quantity.TIME, None),
    "confidence": (1, Quantity.NUMBER, None),
    "time": (1, Quantity.TIME, None),
}
_FRAMES = ("world", "body")


def object_entries(top: Section, model: MjModel, time_unit: str | float | None) -> tuple[ObjectEntry, ...]:
    """The objects of ``[objects]``.

    Raises:
        RecordingError: a body that the model does not have, or what :class:`Section` refuses.
    """
    tables = top.section("objects", "[objects]")
    bodies = [model.body(index).name for index in range(1, model.nbody)]
    return tuple(_object(tables.section(name, f"[objects.{name}]"), name, bodies, time_unit) for name in tables.table)


def _object(section: Section, name: str, bodies: list[str], time_unit: str | float | None) -> ObjectEntry:
    units = [unit for _, _, unit in _OBJECT_CHANNELS.values() if unit is not None]
    section.only(*_OBJECT_CHANNELS, *units, "quaternion_order", "body", "linear_velocity_frame", "angular_velocity_frame")
    body = section.text("body", name)
    if body not in bodies:
        raise section.refusal(f"the model has no body {body!r}{nearest(body, bodies)}; it has {listed(bodies)}")
    needed = ("position", "quaternion")
    channels = {
        word: _object_channels(section, name, word, time_unit) for word in _OBJECT_CHANNELS if section.has(word) or word in needed
    }
    xyzw = section.choice("quaternion_order", ("wxyz", "xyzw")) == "xyzw"
    linear = section.choice("linear_velocity_frame", _FRAMES, "world") == "body"
    angular = "angular_velocity" not in channels or section.choice("angular_velocity_frame", _FRAMES) == "body"
    return ObjectEntry(name, body, channels, xyzw, linear, angular)


def _object_channels(section: Section, name: str, word: str, time_unit: str | float | None) -> tuple[DataChannel, ...]:
    width, quantity, unit_key = _OBJECT_CHANNELS[word]
    columns = section.texts(word)
    if len(columns) not in {1, width}:
        raise section.refusal(f"{word} names {len(columns)} columns; it must name {width}, or one array of {width} columns")
    unit = time_unit if quantity is Quantity.TIME else section.unit(unit_key) if unit_key else None
    if unit is not None:
        si_factor(unit, quantity, f"{section.file}, {section.name}, {unit_key or 'unit of time'}")
    return tuple(DataChannel("objects", name, word, column, quantity, unit) for column in columns)


def signal_entries(top: Section) -> tuple[DataChannel, ...]:
    """Other signals of ``[signals]``: ``supply_v = "column"``, or ``supply_v = { column = "vbat", unit = "mV" }``.

    Raises:
        RecordingError: what :class:`Section` refuses.
    """
    tables = top.section("signals", "[signals]")
    return tuple(_signal(tables, name) for name in tables.table)


def _signal(tables: Section, name: str) -> DataChannel:
    if isinstance(tables.table[name], str):
        return DataChannel("signals", name, "", tables.text(name), Quantity.ANY)
    section = tables.section(name, f"[signals.{name}]")
    section.only("column", "unit")
    unit = section.unit("unit")
    if unit is not None:
        si_factor(unit, Quantity.ANY, f"{section.file}, {section.name}, unit")
    return DataChannel("signals", name, "", section.text("column"), Quantity.ANY, unit)


NominalValue = float | tuple[float, ...] | dict[str, float]
"""One number, three for an axis or camera each, or one for each joint by name."""


@dataclass(frozen=True)
class Controller:
    """What turned position targets into torque: stiffness (target - position) - damping velocity + desired torque, limited.

    By joint; a joint without a torque limit has none. N m/rad, N m s/rad and N m; for slide joints N/m, N s/m and N.
    """

    kind: str
    stiffness_nm_rad: Mapping[str, float]
    damping_nm_s_rad: Mapping[str, float]
    torque_limit_nm: Mapping[str, float]


def nominal_values(top: Section, joints: Sequence[str]) -> dict[str, NominalValue]:
    """Values to start from, by "effect.parameter" as the catalogue names them.

    Args:
        top: the file.
        joints: names of the model's joints.

    Raises:
        RecordingError: an unknown effect, parameter or joint, or a value that cannot be.
    """
    section = top.section("nominal", "[nominal]")
    values: dict[str, NominalValue] = {}
    for key, value in _flat(section.table):
        if key not in PARAMETERS:
            raise section.refusal(f"unknown parameter {key!r}{nearest(key, PARAMETERS)}; {_valid(key)}")
        values[key] = _value(section, key, value, joints)
    return values


def controller(top: Section, joints: Sequence[str]) -> Controller | None:
    """The stated controller, None without one.

    Raises:
        RecordingError: an unknown kind or joint, or a gain that is missing or negative.
    """
    if not top.has("controller"):
        return None
    section = top.section("controller", "[controller]")
    section.only("kind", "stiffness", "damping", "torque_limit")
    kind = section.choice("kind", ("pd",))
    return Controller(kind, *(_per_joint(section, key, joints) for key in ("stiffness", "damping", "torque_limit")))


def tolerance(top: Section) -> Tolerance:
    """What ``[tolerance]`` says that the model may be off by; usual shares where it says nothing.

    Raises:
        RecordingError: a share that is none, or one of 0.5 and more, with which no model says anything.
    """
    section = top.section("tolerance", "[tolerance]")
    section.only(*_TOLERANCES)
    found = {name: section.number(name) for name in _TOLERANCES if section.has(name)}
    for name, share in found.items():
        if not 0.0 <= share < 0.5:
            raise section.refusal(f"{name} is {share:g}; it must be a share from 0 to 0.5, such as 0.02 for 2 %")
    return Tolerance(**found)


def _flat(table: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Both ``"effect.parameter" = ...`` and the table that TOML makes of ``effect.parameter = ...``."""
    flat = []
    for key, value in table.items():
        if isinstance(value, Mapping) and key not in PARAMETERS and "." not in key:
            flat += [(f"{key}.{inner}", inner_value) for inner, inner_value in value.items()]
        else:
            flat.append((key, value))
    return flat


def _valid(key: str) -> str:
    effect = CATALOGUE.get(key.partition(".")[0])
    if effect is None:
        return f"it must be effect.parameter, with an effect of {listed(list(CATALOGUE))}"
    return f"{effect.name} has {listed([effect.key(parameter) for parameter in effect.all_parameters])}"


def _value(section: Section, key: str, value: Any, joints: Sequence[str]) -> NominalValue:
    parameter = PARAMETERS[key]
    if isinstance(value, Mapping):
        if parameter.scope is not Scope.JOINT:
            raise section.refusal(f"{key} is a table of joints, but it has no value for each joint; give a number")
        _known(section, key, value, joints)
        return {joint: _signed(section, f"{key}, {joint}", number, parameter) for joint, number in value.items()}
    if isinstance(value, list):
        if parameter.scope not in {Scope.VECTOR, Scope.CAMERA} or len(value) != parameter.width:
            raise section.refusal(f"{key} is a list of {len(value)}; give {_form(parameter)}")
        return tuple(_signed(section, key, number, parameter) for number in value)
    if parameter.scope is Scope.VECTOR:
        raise section.refusal(f"{key} is one number; give {_form(parameter)}")
    return _signed(section, key, value, parameter)


def _form(parameter: Parameter) -> str:
    if parameter.scope is Scope.JOINT:
        return "a number, or a table with one for each joint"
    if parameter.scope is Scope.VECTOR:
        return f"a list of {parameter.width}"
    return "a number" if parameter.width == 1 else f"a number or a list of {parameter.width}"


def _signed(section: Section, key: str, value: Any, parameter: Parameter) -> float:
    """A finite number; the catalogue's bounds are for one robot, but what cannot be negative there cannot be elsewhere."""
    number = section.finite(key, value)
    if parameter.lower >= 0.0 > number:
        raise section.refusal(f"{key} is {number:g}; it cannot be negative")
    return number


def _per_joint(section: Section, key: str, joints: Sequence[str]) -> dict[str, float]:
    value = section.table.get(key)
    if value is None:
        if key == "torque_limit":
            return {}
        raise section.refusal(f"{key} is missing; give a number, or a table with one for each joint")
    if isinstance(value, Mapping):
        _known(section, key, value, joints)
    gains = dict(value) if isinstance(value, Mapping) else dict.fromkeys(joints, value)
    checked = {joint: section.finite(f"{key} of {joint}", gain) for joint, gain in gains.items()}
    for joint, gain in checked.items():
        if gain < 0.0:
            raise section.refusal(f"{key} of {joint} is {gain:g}; it cannot be negative")
    return checked


def _known(section: Section, key: str, table: Mapping[str, Any], joints: Sequence[str]) -> None:
    for joint in table:
        if joint not in joints:
            raise section.refusal(f"{key} names a joint {joint!r}{nearest(joint, joints)}; the model has {listed(joints)}")


_KEYS = ("title", "data", "model", "nominal", "tolerance", "recording", "time", "joints", "objects", "signals", "controller")
_TOLERANCES = ("mass", "inertia", "centre", "friction")
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
        if (
            "position_target" in joint.channels
            and joint.servo is None
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
