"""What a user is told of a robot's effects: groups in plain words, each with the effects that it stands for.

A group's name says what a researcher can do something about, and no robot's numbers follow from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.physics import Physics


@dataclass(frozen=True)
class Cause:
    """A group of effects: a name for tables, its words, and its effects."""

    name: str
    words: str
    effects: tuple[str, ...]


CAUSES: tuple[Cause, ...] = (
    Cause(
        "joint_friction",
        "friction at the joints",
        ("coulomb_friction", "viscous_friction", "stribeck_friction", "load_friction", "directional_friction"),
    ),
    Cause("late_commands", "late commands", ("action_delay", "timing_jitter")),
    Cause(
        "motors",
        "motors that give another torque",
        (
            "torque_constant",
            "torque_saturation",
            "supply_sag",
            "thermal_derating",
            "cogging",
            "action_noise",
            "position_gain",
            "safety_damping",
        ),
    ),
    Cause(
        "links",
        "links, play and springs of the fingers",
        ("backlash", "link_mass", "rotor_inertia", "joint_stiffness", "joint_limits"),
    ),
    Cause("table", "a table that is not level", ("table_tilt", "gravity")),
    Cause(
        "object",
        "grip, weight and size of the object",
        (
            "fingertip_friction",
            "table_friction",
            "finger_table_friction",
            "cube_mass",
            "cube_size",
            "contact_stiffness",
            "cube_pushes",
        ),
    ),
    Cause(
        "encoders",
        "joints measured wrong",
        ("encoder_offset", "encoder_quantisation", "velocity_filter", "joint_noise", "joint_episode_noise"),
    ),
    Cause("late_camera", "a late camera", ("tracking_rate", "tracking_latency", "tracking_jitter")),
    Cause(
        "blind_camera",
        "a camera that misses the object",
        ("tracking_dropout", "colour_segmentation", "occlusion_by_fingers", "foreign_occlusion", "orientation_jumps"),
    ),
    Cause(
        "off_camera",
        "a camera that sees the object elsewhere",
        ("tracking_scale", "tracking_offset", "tracking_noise", "tracking_episode_noise", "observation_noise"),
    ),
    Cause(
        "images",
        "how the cameras' images look",
        (
            "camera_pose",
            "camera_lens",
            "lamp",
            "surroundings",
            "face_paint",
            "gloss",
            "exposure",
            "white_balance",
            "image_blur",
            "image_noise",
        ),
    ),
    Cause(
        "fault",
        "a fault of the robot",
        ("stuck_joint", "encoder_jump", "controller_restart", "dead_camera"),
    ),
)


def present(physics: Sequence[Physics]) -> tuple[Cause, ...]:
    """The groups of which a robot has any effect at any time of a trial; each keeps only what the robot has."""
    having = {name for name in CATALOGUE if any(each.has(name) for each in physics)}
    kept = [replace(cause, effects=tuple(name for name in cause.effects if name in having)) for cause in CAUSES]
    return tuple(cause for cause in kept if cause.effects)


def cause_of(effect: str) -> Cause:
    """The group of an effect."""
    return next(cause for cause in CAUSES if effect in cause.effects)
