"""What a study.toml says of the model: values that effects start from, the controller, and how exact the model is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mujoco import MjModel, mjtEq, mjtObj, mjtWrap

from sim_backend.effects.catalogue import CATALOGUE, PARAMETERS
from sim_backend.effects.effect import Parameter, Scope
from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance
from sim_backend.reality_gap.measured.foreign.naming import listed, nearest
from sim_backend.reality_gap.measured.foreign.study_section import Section

_TOLERANCES = ("mass", "inertia", "centre", "friction", "zero")
_OF_BEARINGS = ("give_rad", "creep_rad_s")
_OF_FOLLOWERS = (
    ": give a joint that follows another no joint of its own, and add its mass (of a hinge: its inertia about the axis) and its "
    "armature to the other's armature, and its damping to the other's damping, all times the square of the ratio"
)
NominalValue = float | tuple[float, ...] | dict[str, float]
"""One number, three for an axis or camera each, or one for each joint by name."""


@dataclass(frozen=True)
class Controller:
    """What turned targets into torque: stiffness (target - position) + damping (velocity target - velocity) + desired, limited.

    By joint; a joint without a torque limit has none. N m/rad, N m s/rad and N m; for slide joints N/m, N s/m and N. One
    ``on_board`` runs beside the motors, so that a delay is one of targets.
    """

    kind: str
    stiffness_nm_rad: Mapping[str, float]
    damping_nm_s_rad: Mapping[str, float]
    torque_limit_nm: Mapping[str, float]
    on_board: bool = False


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
    section.only("kind", "stiffness", "damping", "torque_limit", "on_board")
    kind, on_board = section.choice("kind", ("pd",)), section.flag("on_board") or False
    stiffness, damping, limit = (_per_joint(section, key, joints) for key in ("stiffness", "damping", "torque_limit"))
    return Controller(kind, stiffness, damping, limit, on_board)


def tolerance(top: Section) -> Tolerance:
    """What ``[tolerance]`` says that the model may be off by; usual shares and bearings where it says nothing.

    Raises:
        RecordingError: a share that is none, or one of 0.5 and more, with which no model says anything; the same of bearings.
    """
    section = top.section("tolerance", "[tolerance]")
    section.only(*_TOLERANCES, *_OF_BEARINGS)
    found = {name: section.number(name) for name in (*_TOLERANCES, *_OF_BEARINGS) if section.has(name)}
    for name, much in found.items():
        if 0.0 <= much < 0.5:
            continue
        if name in _OF_BEARINGS:
            usual = f"such as {getattr(Tolerance, name):g}: bearings hardly move before they slip"
            raise section.refusal(f"{name} is {much:g}; it must be from 0 to 0.5, {usual}")
        raise section.refusal(f"{name} is {much:g}; it must be a share from 0 to 0.5, such as 0.02 for 2 %")
    return Tolerance(**found)


def refuse_linkages(top: Section, model: MjModel, recorded: Sequence[str]) -> None:
    """Refuse equalities that recorded joints move: a study leaves them out, so that it would blame the joints for their forces.

    Args:
        top: the file.
        model: with its equalities.
        recorded: names of joints.

    Raises:
        RecordingError: which equality, and a joint that moves it.
    """
    moved = {int(model.joint(name).id) for name in recorded}
    for i in np.flatnonzero(model.eq_active0):
        kind, ends = int(model.eq_type[i]), (int(model.eq_obj1id[i]), int(model.eq_obj2id[i]))
        if kind == int(mjtEq.mjEQ_JOINT):
            between = set(ends)
        elif kind in (int(mjtEq.mjEQ_CONNECT), int(mjtEq.mjEQ_WELD)):
            of_sites = int(model.eq_objtype[i]) == int(mjtObj.mjOBJ_SITE)
            first, second = (int(model.site_bodyid[end]) if of_sites else end for end in ends)
            between = _joints_above(model, first) ^ _joints_above(model, second)
        elif kind == int(mjtEq.mjEQ_TENDON):
            between = set[int]().union(*(_joints_along(model, tendon) for tendon in ends if tendon >= 0))
        else:
            continue
        if touched := sorted(between & moved):
            joint, name = model.joint(touched[0]).name, model.equality(i).name
            follower = _OF_FOLLOWERS if kind == int(mjtEq.mjEQ_JOINT) else ""
            raise top.refusal(
                f"the model's equality {name or i}, which {joint} moves, cannot be judged: a study leaves equalities out, and "
                f"would blame {joint} for what hangs on it. Leave its joints out of [joints], or write a model that moves alike "
                f"without it{follower}"
            )


def _joints_along(model: MjModel, tendon: int) -> set[int]:
    """Joints that may move a tendon: those that it winds on, and those above the sites that it runs through."""
    found, first = set[int](), int(model.tendon_adr[tendon])
    for i in range(first, first + int(model.tendon_num[tendon])):
        kind, wrapped = int(model.wrap_type[i]), int(model.wrap_objid[i])
        if kind == int(mjtWrap.mjWRAP_JOINT):
            found.add(wrapped)
        elif kind == int(mjtWrap.mjWRAP_SITE):
            found |= _joints_above(model, int(model.site_bodyid[wrapped]))
    return found


def _joints_above(model: MjModel, body: int) -> set[int]:
    """Joints that move a body."""
    found = set[int]()
    while body > 0:
        found |= set(range(int(model.body_jntadr[body]), int(model.body_jntadr[body] + model.body_jntnum[body])))
        body = int(model.body_parentid[body])
    return found


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
