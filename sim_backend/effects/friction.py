"""Friction of the joints.

Constant and viscous friction are MuJoCo's own. Friction that depends on speed, load or direction moves the bound of MuJoCo's
friction constraint in every step, so that the solver still decides what sticks.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from sim_backend.effects.effect import Acts, Effect, Group, Parameter, per_joint
from sim_backend.trifinger import constants as c

if TYPE_CHECKING:
    from mujoco import MjModel, MjsJoint, MjSpec

DIRECTION_SPEED_RAD_S = 0.02
"""Within this speed the bound blends from one direction's to the other's."""
MOVING_BOUNDS = ("stribeck_friction", "load_friction", "directional_friction", "stuck_joint")
_ROW_NM = 1e-9  # gives a joint its constraint row, for the control callback to set
SOLREF, SOLIMP = [0.004, 1.0], [0.999, 0.9999, 0.001, 0.5, 2.0]
"""Of constraints of joints, stiff: a stuck joint creeps by less than 0.001 rad/s."""


def coulomb_friction(spec: "MjSpec", values: Mapping[str, np.ndarray]) -> None:
    """Constant friction as ``frictionloss``."""
    for name, torque_nm in zip(c.JOINT_NAMES, values["torque_nm"], strict=True):
        set_bound(spec.joint(name), torque_nm)


def viscous_friction(spec: "MjSpec", values: Mapping[str, np.ndarray]) -> None:
    """Friction in proportion to speed as ``damping``."""
    for name, damping in zip(c.JOINT_NAMES, values["damping_nm_s_rad"], strict=True):
        spec.joint(name).damping[0] = damping


def reserve_bounds(spec: "MjSpec") -> None:
    """Give every joint a friction constraint whose bound the control callback sets."""
    for name in c.JOINT_NAMES:
        joint = spec.joint(name)
        set_bound(joint, max(float(joint.frictionloss), _ROW_NM))


def set_bound(joint: "MjsJoint", torque_nm: float) -> None:
    """Constant friction of one joint of a specification, N m, stiff enough to stick."""
    joint.frictionloss = torque_nm
    if torque_nm > 0.0:
        joint.solref_friction, joint.solimp_friction = SOLREF, SOLIMP


def make_stiff(model: "MjModel", dofs: np.ndarray) -> None:
    """Let the friction constraints of some degrees of freedom of a compiled model stick as those of :func:`set_bound` do."""
    model.dof_solref[dofs], model.dof_solimp[dofs] = SOLREF, SOLIMP


@numba.njit(inline="always")
def stribeck_bound_nm(extra_nm: float, speed_rad_s: float, exponent: float, velocity_rad_s: float) -> float:
    """What is added to the bound near standstill."""
    if extra_nm == 0.0:
        return 0.0
    ratio = velocity_rad_s / speed_rad_s
    return extra_nm * math.exp(-ratio * ratio if exponent == 2.0 else -(abs(ratio) ** exponent))


@numba.njit(inline="always")
def load_bound_nm(coefficient: float, torque_nm: float, external_coefficient: float, external_nm: float) -> float:
    """What is added to the bound by the motor's torque on the gear, and by the joint's load from outside."""
    return coefficient * abs(torque_nm) + external_coefficient * abs(external_nm)


@numba.njit(inline="always")
def directional_bound_nm(difference_nm: float, velocity_rad_s: float) -> float:
    """What is added to the bound when turning towards plus, and taken when turning towards minus."""
    if difference_nm == 0.0:
        return 0.0
    return difference_nm * math.tanh(velocity_rad_s / DIRECTION_SPEED_RAD_S)


@numba.njit(inline="always")
def stuck_bound_nm(holding_torque_nm: float) -> float:
    """What a jammed joint holds."""
    return holding_torque_nm


def _effect(
    name: str,
    about: str,
    source: str,
    acts: Acts,
    apply: Callable[..., Any],
    *parameters: Parameter,
    shape: Sequence[Parameter] = (),
    group: Group = Group.ACTUATION,
) -> Effect:
    return Effect(name, group, about, source, acts, parameters, apply, tuple(shape))


_BAM = "ladder of friction models of Rhoban/bam (arXiv 2410.08650)"

EFFECTS = (
    _effect(
        "coulomb_friction",
        "a constant torque against motion, and as much holding at rest",
        f"{_BAM}, m1; MuJoCo frictionloss",
        Acts.MODEL,
        coulomb_friction,
        per_joint("torque_nm", "N m", 0.0, 0.5, 0.0, "of each joint"),
    ),
    _effect(
        "viscous_friction",
        "a torque against motion in proportion to speed",
        f"{_BAM}, m1; MuJoCo damping",
        Acts.MODEL,
        viscous_friction,
        per_joint("damping_nm_s_rad", "N m s/rad", 0.0, 0.5, 0.0, "of each joint"),
    ),
    _effect(
        "stribeck_friction",
        "friction that is larger near standstill",
        f"{_BAM}, m2",
        Acts.CONTROL,
        stribeck_bound_nm,
        per_joint("extra_nm", "N m", 0.0, 0.2, 0.0, "at rest, above the constant part"),
        shape=(
            per_joint("speed_rad_s", "rad/s", 0.005, 2.0, 0.1, "at which it has fallen to 1/e"),
            per_joint("exponent", "", 0.5, 4.0, 2.0, "of the speed: with 2 it falls off like a bell, with 1 from standstill on"),
        ),
    ),
    _effect(
        "load_friction",
        "friction that grows with the torque that the gear transmits",
        f"{_BAM}, m3",
        Acts.CONTROL,
        load_bound_nm,
        per_joint("coefficient", "", 0.0, 0.6, 0.0, "friction torque for each N m of motor torque"),
        per_joint(
            "external_coefficient", "", 0.0, 0.6, 0.0, "friction torque for each N m by which gravity and motion load the joint"
        ),
    ),
    _effect(
        "directional_friction",
        "friction that is larger in one direction than in the other",
        f"{_BAM}, m5",
        Acts.CONTROL,
        directional_bound_nm,
        per_joint("difference_nm", "N m", -0.2, 0.2, 0.0, "added when turning towards plus, taken when turning towards minus"),
    ),
    _effect(
        "stuck_joint",
        "a joint that is jammed",
        "a fault that the laboratory's self-test looks for (robot_fingers scripts/trifingerpro_post_submission.py)",
        Acts.CONTROL,
        stuck_bound_nm,
        per_joint("holding_torque_nm", "N m", 0.0, 20.0, 0.0, "what the jam holds"),
        group=Group.FAULT,
    ),
)
