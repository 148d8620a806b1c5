"""Effects on links, joints and gravity; all of them are MuJoCo's own and applied to the specification before it is compiled."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sim_backend.effects.effect import Acts, Effect, Group, Parameter, per_axis, per_joint, per_robot
from sim_backend.trifinger import constants as c

if TYPE_CHECKING:
    from mujoco import MjSpec

_LINKS = ("upper", "middle", "lower")


def link_mass(spec: "MjSpec", values: Mapping[str, np.ndarray]) -> None:
    """Scale mass and inertia of each link; the tip belongs to the lower link."""
    for index, factor in enumerate(values["factor"]):
        finger = c.FINGER_NAMES[index // 3]
        links = (_LINKS[index % 3], "tip") if index % 3 == 2 else (_LINKS[index % 3],)
        for link in links:
            body = spec.body(f"{finger}_{link}")
            body.mass, body.fullinertia = body.mass * factor, np.asarray(body.fullinertia) * factor


def rotor_inertia(spec: "MjSpec", values: Mapping[str, np.ndarray]) -> None:
    """Inertia of the rotors as ``armature``."""
    for name, inertia in zip(c.JOINT_NAMES, values["armature_kg_m2"], strict=True):
        spec.joint(name).armature = inertia


def joint_stiffness(spec: "MjSpec", values: Mapping[str, np.ndarray]) -> None:
    """A spring at each joint, as the motor cables are."""
    for name, stiffness, reference in zip(c.JOINT_NAMES, values["stiffness_nm_rad"], values["reference_rad"], strict=True):
        joint = spec.joint(name)
        joint.stiffness[0], joint.springref = stiffness, reference


def joint_limits(spec: "MjSpec", values: Mapping[str, np.ndarray]) -> None:
    """Shift the ends of each joint's range."""
    for name, lower, upper in zip(c.JOINT_NAMES, values["lower_rad"], values["upper_rad"], strict=True):
        joint = spec.joint(name)
        joint.range = np.asarray(joint.range) + np.array([lower, upper])


def table_tilt(spec: "MjSpec", values: Mapping[str, float]) -> None:
    """Turn gravity as a table does that stands askew."""
    spec.option.gravity = seen_from_tilted_table(spec.option.gravity, float(values["roll_rad"]), float(values["pitch_rad"]))


def seen_from_tilted_table(vector: np.ndarray, roll_rad: float, pitch_rad: float) -> np.ndarray:
    """A vector, shape (3,), turned about x by the roll, then about y by the pitch."""
    x, y, z = vector
    y, z = y * np.cos(roll_rad) + z * np.sin(roll_rad), -y * np.sin(roll_rad) + z * np.cos(roll_rad)
    x, z = x * np.cos(pitch_rad) - z * np.sin(pitch_rad), x * np.sin(pitch_rad) + z * np.cos(pitch_rad)
    return np.array([x, y, z])


def gravity(spec: "MjSpec", values: Mapping[str, np.ndarray]) -> None:
    """Add to the gravity vector."""
    spec.option.gravity = np.asarray(spec.option.gravity) + values["offset_m_s2"]


def _effect(
    name: str, about: str, source: str, apply: Callable[..., Any], *parameters: Parameter, shape: Sequence[Parameter] = ()
) -> Effect:
    return Effect(name, Group.BODY, about, source, Acts.MODEL, parameters, apply, tuple(shape))


EFFECTS = (
    _effect(
        "link_mass",
        "links are heavier or lighter than in the URDF, with their inertia",
        "Dactyl (arXiv 1808.00177): robot link masses; robot_properties_fingers gives masses from CAD",
        link_mass,
        per_joint("factor", "", 0.3, 3.0, 1.0, "of mass and inertia of the link behind each joint"),
    ),
    _effect(
        "rotor_inertia",
        "the rotors' inertia, reflected through the gear",
        "absent from the URDF; MuJoCo armature",
        rotor_inertia,
        per_joint("armature_kg_m2", "kg m^2", 0.0, 0.01, 0.0, "on the joint's side of the gear"),
    ),
    _effect(
        "joint_stiffness",
        "cables pull a joint towards a position",
        "MuJoCo joint stiffness; motor cables run along the links of the finger",
        joint_stiffness,
        per_joint("stiffness_nm_rad", "N m/rad", 0.0, 0.5, 0.0, "of the spring"),
        shape=(per_joint("reference_rad", "rad", -2.7, 1.6, 0.0, "where the spring rests"),),
    ),
    _effect(
        "joint_limits",
        "the mechanical range differs from the nominal one",
        "Dactyl (arXiv 1808.00177) and IsaacGymEnvs Trifinger.yaml randomise joint limits",
        joint_limits,
        per_joint("lower_rad", "rad", -0.3, 0.3, 0.0, "added to the lower end"),
        per_joint("upper_rad", "rad", -0.3, 0.3, 0.0, "added to the upper end"),
    ),
    _effect(
        "table_tilt",
        "the whole platform stands askew",
        "no platform stands exactly level",
        table_tilt,
        per_robot("roll_rad", "rad", -0.2, 0.2, 0.0, "about the world's x axis"),
        per_robot("pitch_rad", "rad", -0.2, 0.2, 0.0, "about the world's y axis"),
    ),
    _effect(
        "gravity",
        "another gravity vector",
        "Dactyl (arXiv 1808.00177) and IsaacGymEnvs Trifinger.yaml add noise to gravity",
        gravity,
        per_axis("offset_m_s2", "m/s^2", -10.0, 10.0, 0.0, "added to (0, 0, -9.81)"),
    ),
)
