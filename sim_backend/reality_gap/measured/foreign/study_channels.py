"""What a study.toml says of columns: which one holds what of which joint, object or signal, and in which unit."""

from collections.abc import Mapping
from dataclasses import dataclass

from mujoco import MjModel, mjtJoint

from sim_backend.reality_gap.measured.foreign.measurement_units import Quantity, si_factor
from sim_backend.reality_gap.measured.foreign.naming import listed, nearest
from sim_backend.reality_gap.measured.foreign.study_section import Section

_HINGE = {
    "position": Quantity.ANGLE,
    "velocity": Quantity.ANGULAR_VELOCITY,
    "commanded_torque": Quantity.TORQUE,
    "measured_torque": Quantity.TORQUE,
    "desired_torque": Quantity.TORQUE,
    "position_target": Quantity.ANGLE,
    "velocity_target": Quantity.ANGULAR_VELOCITY,
    "temperature": Quantity.TEMPERATURE,
}
_SERVO = ("gain", "supply", "enabled")
_MOTOR = ("voltage", "duty", "supply", "enabled")
"""What the tables of a servo and of a motor may have as a number or as a column."""
_TABLES = ("servo", "motor")
_DRIVEN = ("torque", "commanded_torque", "measured_torque", "desired_torque", "position_target", "velocity_target", *_TABLES)
"""What only a joint has that something drives."""
_SLIDE = {Quantity.ANGLE: Quantity.LENGTH, Quantity.ANGULAR_VELOCITY: Quantity.VELOCITY, Quantity.TORQUE: Quantity.FORCE}
JOINT_CHANNELS = tuple(_HINGE)
_UNIT_KEYS = {
    "position": "position_unit",
    "position_target": "position_unit",
    "velocity": "velocity_unit",
    "velocity_target": "velocity_unit",
    "commanded_torque": "torque_unit",
    "measured_torque": "torque_unit",
    "desired_torque": "torque_unit",
    "temperature": "temperature_unit",
}
"""Of all channels that share one."""
_OWN_UNIT_KEYS = {
    "position_target": "position_target_unit",
    "velocity_target": "velocity_target_unit",
    "commanded_torque": "commanded_torque_unit",
    "measured_torque": "measured_torque_unit",
    "desired_torque": "desired_torque_unit",
}
"""Of one channel that is not in the unit of its kind."""
_SIGNS = ("sign", "torque_sign", "measured_torque_sign")
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
class VoltageMotor:
    """A motor that is driven by voltage: torque = kt voltage / R - kt^2 velocity / R.

    A servo makes the voltage itself: duty = clip(gain (target - position), -1, 1), voltage = duty supply. Of others the voltage
    was recorded, or its duty.

    Attributes:
        table: of study.toml that it stands in, ``servo`` or ``motor``.
        constants: ``gain`` (duty for a radian), ``voltage``, ``supply`` (V), ``duty``, ``enabled``, as far as these are numbers.
        torque_constant_nm_a: on the joint's side.
        resistance_ohm: of its windings.
    """

    table: str
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
        torque_sign: -1 where torques, or a motor's voltage, count against positions.
        measured_torque_sign: the same of measured torques, which may come from another device.
        zero: reading at which the model's joint is at 0, in the unit of the position column.
        ambient: temperature around the motor, in the unit of the temperature column.
        wrapped: whether angles jump by a turn; None leaves it to the data.
        passive: whether nothing drives it.
        motor: by whose law a position target, a voltage or a duty becomes torque, None where ``[controller]`` does or nothing is
            known.
    """

    name: str
    slide: bool
    channels: Mapping[str, DataChannel]
    sign: float = 1.0
    torque_sign: float = 1.0
    measured_torque_sign: float = 1.0
    zero: float = 0.0
    ambient: float = 0.0
    wrapped: bool | None = None
    passive: bool = False
    motor: VoltageMotor | None = None

    def sign_of(self, word: str) -> float:
        """1 or -1: which way a channel counts in the model's direction."""
        if word == "measured_torque":
            return self.sign * self.measured_torque_sign
        return self.sign * (self.torque_sign if word.endswith("torque") else 1.0)


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
    numbers = (*_SIGNS, "zero", "ambient", "wrapped", "passive")
    section.only(*JOINT_CHANNELS, "torque", "torque_kind", *_UNIT_KEYS.values(), *_OWN_UNIT_KEYS.values(), *numbers, *_TABLES)
    section.text("position")
    columns = {word: section.text(word) for word in JOINT_CHANNELS if section.has(word)} | _torque(section)
    channels = {word: _joint_channel(section, name, word, column, slide=slide) for word, column in columns.items()}
    _refuse_said_of_nothing(section, columns)
    signs = {key: section.number(key, 1.0) for key in _SIGNS}
    for key, sign in signs.items():
        if sign not in {-1.0, 1.0}:
            raise section.refusal(f"{key} is {sign:g}; it must be 1 or -1 (a scale belongs into the unit)")
    if not section.has("measured_torque_sign"):
        signs["measured_torque_sign"] = signs["torque_sign"]
    if section.has("temperature") and not section.has("ambient"):
        raise section.refusal("temperature needs ambient, the temperature around the motor in the same unit (0 if it is a rise)")
    motor, columns_of_motor = _motor(section, name)
    passive = section.flag("passive") or False
    driven = [word for word in _DRIVEN if section.has(word)]
    turns = {*columns, *columns_of_motor} & {"commanded_torque", "measured_torque", "desired_torque"} or section.has("motor")
    if signs["torque_sign"] < 0.0 and not turns:
        raise section.refusal("torque_sign turns nothing: the joint has no torque, voltage or duty")
    if passive and driven:
        raise section.refusal(f"the joint is passive, which nothing drives, and has {driven[0]}")
    return JointEntry(
        name,
        slide,
        channels | columns_of_motor,
        signs["sign"],
        signs["torque_sign"],
        signs["measured_torque_sign"],
        section.number("zero", 0.0),
        section.number("ambient", 0.0),
        section.flag("wrapped"),
        passive,
        motor,
    )


def _refuse_said_of_nothing(joint: Section, columns: Mapping[str, str]) -> None:
    """A unit or a sign of one channel is of a column that is named."""
    for word, key in (*_OWN_UNIT_KEYS.items(), ("measured_torque", "measured_torque_sign")):
        if joint.has(key) and word not in columns:
            raise joint.refusal(f"{key} is given, but the joint has no {word}")


def _motor(joint: Section, name: str) -> tuple[VoltageMotor | None, dict[str, DataChannel]]:
    """The servo or motor of a joint, and what it reads from columns."""
    tables = [table for table in _TABLES if joint.has(table)]
    if not tables:
        return None, {}
    table, *others = tables
    section = joint.section(table, f"[joints.{name}.{table}]")
    if others:
        raise section.refusal("a joint has a servo or a motor, not both")
    keys = _SERVO if table == "servo" else _MOTOR
    section.only(*keys, "kt", "resistance")
    if table == "servo" and not joint.has("position_target"):
        raise section.refusal("a servo needs position_target, the column of what the joint was to be at")
    if table == "motor":
        _refuse_unclear_drive(joint, section)
    needed = keys if table == "servo" else [key for key in keys if section.has(key)]
    constants, channels = {"enabled": 1.0}, {}
    for key in needed:
        value, word = section.table.get(key), f"{table}_{key}"
        if isinstance(value, Mapping):
            column = section.section(key, f"[joints.{name}.{table}] {key}")
            column.only("column", "unit")
            channels[word] = DataChannel("joints", name, word, column.text("column"), Quantity.ANY, column.unit("unit"))
        elif isinstance(value, str):
            channels[word] = DataChannel("joints", name, word, section.text(key), Quantity.ANY)
        elif value is not None or key not in constants:
            constants[key] = section.number(key)
    found = VoltageMotor(table, constants, section.number("kt"), section.number("resistance"))
    if not (found.torque_constant_nm_a > 0.0 and found.resistance_ohm > 0.0):
        raise section.refusal("kt and resistance must be above 0")
    return found, channels


def _refuse_unclear_drive(joint: Section, section: Section) -> None:
    """A motor's voltage must be one column, and no other column may say what it was sent."""
    if section.has("voltage") == section.has("duty"):
        raise section.refusal("a motor needs voltage or duty, the column of what it was driven with, and not both")
    if section.has("duty") and not section.has("supply"):
        raise section.refusal("duty needs supply, the voltage that it is a share of")
    said = {*joint.table, *_torque(joint)}
    if sent := [word for word in ("position_target", "velocity_target", "desired_torque", "commanded_torque") if word in said]:
        raise section.refusal(f"the joint has {sent[0]}, too: what its motor was sent is either that or a voltage")


def _joint_channel(section: Section, name: str, word: str, column: str, *, slide: bool) -> DataChannel:
    quantity = _SLIDE.get(_HINGE[word], _HINGE[word]) if slide else _HINGE[word]
    own_key = _OWN_UNIT_KEYS.get(word, "")
    unit_key = own_key if section.has(own_key) else _UNIT_KEYS[word]
    channel = DataChannel("joints", name, word, column, quantity, section.unit(unit_key))
    if channel.unit is not None:
        si_factor(channel.unit, quantity, f"{section.file}, {section.name}, {unit_key}")
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
