"""Which effects MuJoCo itself has, as what in plain MJCF, and why it lacks the others.

Values are those of the catalogue's parameters. Every effect that is no part of a compiled robot already has either a law or a
reason here.
"""

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np

from sim_backend.effects import body
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import LOOKS, Acts, Group
from sim_backend.effects.friction import set_bound
from sim_backend.reality_gap.model import native_elements as elements

_Values = Mapping[str, Any]
_Law = Callable[[mujoco.MjSpec, str, _Values], str | None]

REASONS: dict[str, str] = {
    "timing_jitter": "actuator delay is the same in every step",
    "supply_sag": "limits of force do not depend on other motors",
    "thermal_derating": "dcmotor thermal changes the resistance of a motor driven by voltage, not its torque per current",
    "action_noise": "MuJoCo has no noise of actuators",
    "position_gain": "it belongs to the position controller, which the model does not contain",
    "safety_damping": "it belongs to the safety pipeline, which the model does not contain: the model takes applied torques",
    "stribeck_friction": "dcmotor lugre is another law, with bristles that have a stiffness and damping of their own",
    "load_friction": "frictionloss does not depend on the torque of the motor",
    "directional_friction": "frictionloss is the same in both directions",
    "encoder_quantisation": "sensors have no steps",
    "velocity_filter": "sensors have no filter",
    "joint_episode_noise": "sensors have no error that lasts for an episode",
    "controller_restart": "an event in time is not part of a model",
    "cube_pushes": "forces by chance are not part of a model",
}
"""Why an effect of the joints and the cube is not written; what the tracker does is no part of MJCF at all."""


def reason(effect: str) -> str | None:
    """Why plain MJCF does not have an effect; None if it has."""
    if CATALOGUE[effect].group is Group.TRACKING or CATALOGUE[effect].acts is Acts.TRACKER:
        return "the tracker is not part of the model"
    if CATALOGUE[effect].acts in LOOKS:
        return "what images look like is not part of the model"
    return REASONS.get(effect)


def joints_of(spec: mujoco.MjSpec) -> list[str]:
    """Names of all hinges and slides, but for those that are the play of another."""
    kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    return [joint.name for joint in spec.joints if joint.type in kinds and not joint.name.endswith(elements.PLAY_SUFFIX)]


def _joint(spec: mujoco.MjSpec, where: str) -> mujoco.MjsJoint:
    found = spec.joint(where)
    if found is None or where not in joints_of(spec):
        raise ValueError(f"the model has no hinge or slide {where!r}; choose from {', '.join(joints_of(spec))}")
    return found


def _body(spec: mujoco.MjSpec, where: str) -> mujoco.MjsBody:
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


def _coulomb(spec: mujoco.MjSpec, where: str, values: _Values) -> None:
    set_bound(_joint(spec, where), values["torque_nm"])


def _stuck(spec: mujoco.MjSpec, where: str, values: _Values) -> None:
    joint = _joint(spec, where)
    set_bound(joint, float(joint.frictionloss) + values["holding_torque_nm"])


def _viscous(spec: mujoco.MjSpec, where: str, values: _Values) -> None:
    _joint(spec, where).damping[0] = values["damping_nm_s_rad"]


def _armature(spec: mujoco.MjSpec, where: str, values: _Values) -> None:
    _joint(spec, where).armature = values["armature_kg_m2"]


def _stiffness(spec: mujoco.MjSpec, where: str, values: _Values) -> None:
    elements.add_spring(_joint(spec, where), values["stiffness_nm_rad"], values["reference_rad"])


def _play(spec: mujoco.MjSpec, where: str, values: _Values) -> str | None:
    return elements.add_play(_joint(spec, where), values["gap_rad"], values["rotor_inertia_kg_m2"]) if values["gap_rad"] else None


def _range(spec: mujoco.MjSpec, where: str, values: _Values) -> None:
    joint = _joint(spec, where)
    joint.range = np.asarray(joint.range) + [elements.in_units(joint, values[end]) for end in ("lower_rad", "upper_rad")]


def _gravity(spec: mujoco.MjSpec, where: str, values: _Values) -> str | None:
    if where not in ("x", "y", "z"):
        raise ValueError(f"gravity has no axis {where!r}; choose from x, y, z")
    spec.option.gravity["xyz".index(where)] += values["offset_m_s2"]


def _tilt(spec: mujoco.MjSpec, _where: str, values: _Values) -> None:
    body.table_tilt(spec, values)


def _noise(spec: mujoco.MjSpec, where: str, values: _Values) -> str:
    return elements.add_noise(
        spec, _joint(spec, where).name, values["position_rad"], values["velocity_rad_s"], values["torque_nm"]
    )


def _cogging(spec: mujoco.MjSpec, where: str, values: _Values) -> None:
    elements.add_cogging(spec, _joint(spec, where).name, values["amplitude_nm"], values["cycles_per_rad"], values["phase_rad"])


def _encoder(spec: mujoco.MjSpec, where: str, values: _Values) -> None:
    elements.offset_encoder(spec, _joint(spec, where).name, values["offset_rad"])


LAWS: Mapping[str, _Law] = {
    "coulomb_friction": _coulomb,
    "stuck_joint": _stuck,
    "viscous_friction": _viscous,
    "rotor_inertia": _armature,
    "joint_stiffness": _stiffness,
    "joint_limits": _range,
    "backlash": _play,
    "link_mass": lambda spec, where, v: elements.scale_mass(_body(spec, where), v["factor"]),
    "cube_mass": lambda spec, where, v: elements.scale_mass(_body(spec, where), v["factor"]),
    "gravity": _gravity,
    "table_tilt": _tilt,
    "table_friction": lambda spec, where, v: elements.set_friction(spec, _geoms(spec, where), v["coefficient"]),
    "contact_stiffness": lambda spec, where, v: elements.set_contact(
        spec, _geoms(spec, where), v["time_constant_s"], v["damping_ratio"]
    ),
    "action_delay": lambda spec, where, v: elements.delay_action(spec, _joint(spec, where).name, v["delay_s"]),
    "torque_saturation": lambda spec, where, v: elements.saturate_torque(spec, _joint(spec, where).name, v["limit_nm"]),
    "torque_constant": lambda spec, where, v: elements.scale_torque(spec, _joint(spec, where).name, v["error"]),
    "cogging": _cogging,
    "encoder_offset": _encoder,
    "encoder_jump": _encoder,
    "joint_noise": _noise,
}
"""Each takes a specification, the name of a place, and the values there; it returns what it could not write, or None."""
ORDER = {"torque_saturation": -1, "encoder_offset": 1, "encoder_jump": 1, "backlash": 2}
"""Of laws that must be written before or after all others: limits before gains, then encoders, then what adds joints."""
