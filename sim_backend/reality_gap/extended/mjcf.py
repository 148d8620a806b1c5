"""The extended model as plain MJCF of everything that MuJoCo has natively, and a list of what it has not.

The text loads with ``mujoco.MjModel.from_xml_path`` and nothing of this project: the laws are those of ``native_laws.py``, and
what is missing stands in it, too, as ``<custom><text name="not_expressed">``.
"""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sim_backend.driver.robot_model import robot_spec
from sim_backend.effects import body
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Acts
from sim_backend.effects.estimate import Estimate
from sim_backend.effects.friction import set_bound
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.extended import native_laws as laws
from sim_backend.reality_gap.extended.exact_mjcf import exact_numbers
from sim_backend.reality_gap.verdict import Cause
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE, Shape

_Values = Mapping[str, Any]
_Law = Callable[[mujoco.MjSpec, str, _Values], str | None]


def robot_mjcf(
    physics: Physics, *, shape: Shape = CUBE, physics_step_s: float = c.PHYSICS_STEP_S
) -> tuple[mujoco.MjSpec, list[str]]:
    """Specification of a TriFinger with its effects, and sentences that say which of them it does not have, and why.

    Its controls are applied torques, N m, in the order of ``constants.JOINT_NAMES``; the safety pipeline is not in it.

    Args:
        physics: effects of one robot (n = 1).
        shape: the object in the arena.
        physics_step_s: integration step, s; delays hold for this one.

    Raises:
        ValueError: an effect of the catalogue has neither a law nor a reason.
    """
    spec, missing = robot_spec(physics, shape=shape, physics_step_s=physics_step_s), []
    for name, effect in _in_order(name for name in CATALOGUE if physics.has(name)):
        if effect.acts is Acts.MODEL:
            continue
        values = {p.name: physics.value(effect.key(p))[0] for p in effect.all_parameters}
        why, absent = laws.reason(name), effect.parameters[0].absent
        if why is None and name not in _LAWS:
            raise ValueError(f"effect {name} has neither a law here nor a reason in native_laws.REASONS")
        if why is None:
            first = np.broadcast_to(values[effect.parameters[0].name], 9)
            own = [{key: float(np.broadcast_to(value, 9)[j]) for key, value in values.items()} for j in range(9)]
            found = (
                _LAWS[name](spec, c.JOINT_NAMES[j], own[j])
                for j in range(9)
                if first[j] != absent or any(own[j][p.name] != p.absent for p in effect.parameters)
            )
            why = "; ".join(dict.fromkeys(filter(None, found)))
        if why:
            missing.append(f"{name}: {why}")
    _state(spec, missing)
    return spec, missing


def extend_mjcf(spec: mujoco.MjSpec, causes: Iterable[Cause]) -> tuple[mujoco.MjSpec, list[str]]:
    """Any MuJoCo model with the causes that a study accepted, and sentences that say which of them it does not have, and why.

    Values replace those of the model where the catalogue's parameter is absolute (friction, damping, inertia), a spring is put
    beside the model's own, and a factor, an error or an offset multiplies or adds.

    Args:
        spec: the model; it is not changed.
        causes: ``where`` names a joint, or a body for its mass; ``all joints`` are all hinges and slides; for friction and
            stiffness of contacts it names a geom or a body with geoms, for gravity ``x``, ``y`` or ``z``.

    Raises:
        ValueError: the model has nothing of the name that a cause gives as its place.
    """
    extended, missing = spec.copy(), []
    by_place: dict[tuple[str, str], dict[str, float]] = {}
    for cause in causes:
        by_place.setdefault((cause.effect, cause.where), {})[cause.parameter] = cause.value
    for name, effect in _in_order({name: None for name, _ in by_place}):
        for (_, where), given in filter(lambda entry: entry[0][0] == name, by_place.items()):
            values = {p.name: p.absent for p in effect.all_parameters} | given
            why = laws.reason(name)
            if why is None and name not in _LAWS:
                why = "it is defined for a TriFinger only"
            if why is None:
                places = _joints(extended) if where == "all joints" else [where]
                why = "; ".join(dict.fromkeys(filter(None, (_LAWS[name](extended, place, values) for place in places))))
            if why:
                missing.append(f"{name} at {where}: {why}")
    _state(extended, missing)
    return extended, missing


def write_mjcf(spec: mujoco.MjSpec, path: Path, estimate: Estimate | None = None) -> None:
    """Write a specification as MJCF; what ``estimate`` says of its values becomes ``<custom><text name="provenance">``, JSON."""
    written = spec.copy()
    if estimate is not None:
        written.add_text(name="provenance", data=json.dumps(asdict(estimate)))
    path.write_text(mjcf_text(written), encoding="utf-8")


def mjcf_text(spec: mujoco.MjSpec) -> str:
    """A specification as MJCF; numbers of joints, bodies, geoms and actuators keep all of their digits (MuJoCo writes six)."""
    copy = spec.copy()
    model = copy.compile()
    return exact_numbers(copy.to_xml(), model)


def _in_order(names: Iterable[str]):
    """Effects by name, in the order in which their laws must be written: limits before gains, encoders last."""
    return sorted(((name, CATALOGUE[name]) for name in names), key=lambda entry: _ORDER.get(entry[0], 0))


_ORDER = {"torque_saturation": -1, "encoder_offset": 1, "encoder_jump": 1}


def _state(spec: mujoco.MjSpec, missing: list[str]) -> None:
    if missing:
        spec.add_text(name="not_expressed", data=" | ".join(missing))


def _joints(spec: mujoco.MjSpec) -> list[str]:
    kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    return [joint.name for joint in spec.joints if joint.type in kinds]


def _joint(spec: mujoco.MjSpec, where: str):
    found = spec.joint(where)
    if found is None or where not in _joints(spec):
        raise ValueError(f"the model has no hinge or slide {where!r}; choose from {', '.join(_joints(spec))}")
    return found


def _body(spec: mujoco.MjSpec, where: str):
    found = spec.body(where) or (spec.joint(where).parent if spec.joint(where) else None)
    if found is None:
        names = ", ".join(b.name for b in spec.bodies if b.name and b.name != "world")
        raise ValueError(f"the model has no body or joint {where!r}; its bodies are {names}")
    return found


def _geoms(spec: mujoco.MjSpec, where: str) -> list:
    named = spec.geom(where)
    found = [named] if named else list(spec.body(where).geoms) if spec.body(where) else []
    if not found:
        names = ", ".join(geom.name for geom in spec.geoms if geom.name)
        raise ValueError(f"the model has no geom {where!r} and no body of that name with geoms; its geoms are {names}")
    return found


def _coulomb(spec, where, values) -> None:
    set_bound(_joint(spec, where), values["torque_nm"])


def _stuck(spec, where, values) -> None:
    joint = _joint(spec, where)
    set_bound(joint, float(joint.frictionloss) + values["holding_torque_nm"])


def _viscous(spec, where, values) -> None:
    _joint(spec, where).damping[0] = values["damping_nm_s_rad"]


def _armature(spec, where, values) -> None:
    _joint(spec, where).armature = values["armature_kg_m2"]


def _stiffness(spec, where, values) -> None:
    laws.add_spring(_joint(spec, where), values["stiffness_nm_rad"], values["reference_rad"])


def _range(spec, where, values) -> None:
    joint = _joint(spec, where)
    joint.range = np.asarray(joint.range) + [laws.in_units(joint, values[end]) for end in ("lower_rad", "upper_rad")]


def _gravity(spec, where, values) -> str | None:
    if where not in ("x", "y", "z"):
        raise ValueError(f"gravity has no axis {where!r}; choose from x, y, z")
    spec.option.gravity["xyz".index(where)] += values["offset_m_s2"]


def _tilt(spec, _where, values) -> None:
    body.table_tilt(spec, values)


def _noise(spec, where, values) -> str:
    return laws.add_noise(spec, _joint(spec, where).name, values["position_rad"], values["velocity_rad_s"], values["torque_nm"])


def _cogging(spec, where, values) -> None:
    laws.add_cogging(spec, _joint(spec, where).name, values["amplitude_nm"], values["cycles_per_rad"], values["phase_rad"])


def _encoder(spec, where, values) -> None:
    laws.offset_encoder(spec, _joint(spec, where).name, values["offset_rad"])


_LAWS: dict[str, _Law] = {
    "coulomb_friction": _coulomb,
    "stuck_joint": _stuck,
    "viscous_friction": _viscous,
    "rotor_inertia": _armature,
    "joint_stiffness": _stiffness,
    "joint_limits": _range,
    "link_mass": lambda spec, where, v: laws.scale_mass(_body(spec, where), v["factor"]),
    "cube_mass": lambda spec, where, v: laws.scale_mass(_body(spec, where), v["factor"]),
    "gravity": _gravity,
    "table_tilt": _tilt,
    "table_friction": lambda spec, where, v: laws.set_friction(spec, _geoms(spec, where), v["coefficient"]),
    "contact_stiffness": lambda spec, where, v: laws.set_contact(
        spec, _geoms(spec, where), v["time_constant_s"], v["damping_ratio"]
    ),
    "action_delay": lambda spec, where, v: laws.delay_action(spec, _joint(spec, where).name, v["delay_s"]),
    "torque_saturation": lambda spec, where, v: laws.saturate_torque(spec, _joint(spec, where).name, v["limit_nm"]),
    "torque_constant": lambda spec, where, v: laws.scale_torque(spec, _joint(spec, where).name, v["error"]),
    "cogging": _cogging,
    "encoder_offset": _encoder,
    "encoder_jump": _encoder,
    "joint_noise": _noise,
}
"""Each takes a specification, the name of a place, and the values there; it returns what it could not write, or None."""
