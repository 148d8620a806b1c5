"""Which motion shows which effect, and which motion tells two effects apart that look alike.

The orders follow from a simulation (2026-11-21): each effect was given to one joint at a size near its detection limit, and what
that changes in measured positions, velocities and torques was compared, by excitation, with what the other effect of a pair
changes. First comes the excitation in which the smaller of two changes has the largest part that is not parallel to the other.
"""

from dataclasses import dataclass

SHOWN_BY: dict[str, tuple[str, ...]] = {
    "action_delay": ("chirps", "oscillations", "fast_sweeps"),
    "timing_jitter": ("oscillations", "fast_sweeps", "chirps"),
    "torque_constant": ("fast_sweeps", "oscillations", "chirps"),
    "torque_saturation": ("fast_sweeps", "joint_limits", "hold_poses"),
    "supply_sag": ("oscillations", "joint_limits", "fast_sweeps"),
    "thermal_derating": ("hold_poses", "chirps", "slow_ramps"),
    "cogging": ("joint_limits", "slow_ramps", "hold_poses"),
    "action_noise": ("hold_poses", "slow_ramps"),
    "backlash": ("joint_limits", "chirps", "oscillations"),
    "position_gain": ("joint_limits", "chirps", "hold_poses"),
    "safety_damping": ("fast_sweeps", "oscillations", "chirps"),
    "coulomb_friction": ("fast_sweeps", "slow_ramps", "chirps"),
    "viscous_friction": ("fast_sweeps", "oscillations"),
    "stribeck_friction": ("slow_ramps", "joint_limits", "hold_poses"),
    "load_friction": ("fast_sweeps", "oscillations", "chirps"),
    "directional_friction": ("fast_sweeps", "chirps", "joint_limits"),
    "stuck_joint": ("joint_limits", "fast_sweeps"),
    "link_mass": ("fast_sweeps", "oscillations", "chirps"),
    "rotor_inertia": ("chirps", "joint_limits", "oscillations"),
    "joint_stiffness": ("fast_sweeps", "joint_limits", "oscillations"),
    "joint_limits": ("joint_limits",),
    "table_tilt": ("joint_limits", "fast_sweeps", "slide_cube"),
    "gravity": ("joint_limits", "fast_sweeps", "oscillations"),
    "encoder_offset": ("joint_limits", "hold_poses"),
    "encoder_quantisation": ("slow_ramps", "hold_poses"),
    "velocity_filter": ("chirps", "oscillations", "fast_sweeps"),
    "joint_noise": ("hold_poses",),
    "joint_episode_noise": ("joint_limits", "hold_poses"),
    "encoder_jump": ("joint_limits", "fast_sweeps"),
    "controller_restart": ("fast_sweeps", "oscillations"),
    "fingertip_friction": ("slide_cube",),
    "table_friction": ("slide_cube",),
    "cube_mass": ("slide_cube",),
    "cube_size": ("slide_cube",),
    "contact_stiffness": ("slide_cube",),
    "cube_pushes": ("hold_poses",),
    "tracking_rate": ("slide_cube",),
    "tracking_latency": ("slide_cube",),
    "tracking_jitter": ("slide_cube",),
    "tracking_dropout": ("slide_cube", "hold_poses"),
    "tracking_scale": ("slide_cube",),
    "tracking_offset": ("slide_cube", "hold_poses"),
    "tracking_noise": ("hold_poses", "slide_cube"),
    "tracking_episode_noise": ("hold_poses",),
    "observation_noise": ("hold_poses",),
    "orientation_jumps": ("hold_poses", "slide_cube"),
    "colour_segmentation": ("hold_poses", "slide_cube"),
    "occlusion_by_fingers": ("slide_cube", "oscillations"),
    "foreign_occlusion": ("slide_cube",),
    "dead_camera": ("slide_cube", "hold_poses"),
}
"""Excitations in which an effect shows, the best first."""

BY_HAND: dict[str, str] = {
    "finger_table_friction": "press a fingertip on the table and draw it along: no excitation touches the table",
    "fingertip_friction": "lift the cube with a policy (trifarm submit --task lift): a grip shows how much the tips hold",
    "cube_mass": "weigh the cube, or lift it: pushing shows mass and friction as a product",
    "cube_size": "measure the cube with a caliper",
    "tracking_scale": "let the cameras see a known distance, or record tosses: free flight must fall with 9.81 m/s²",
    "torque_constant": "hang a known mass on the finger: from motion alone, torque constants and masses scale together",
    "joint_limits": "lead the joint to its end by hand and read its encoder there",
    "gravity": "turn the base to another orientation: the sensors' zeros stay, gravity does not",
    "thermal_derating": "rest until the motors are cold, then record: only the way from cold to warm shows it",
}
"""What nobody can do by running an excitation alone."""


@dataclass(frozen=True)
class Distinction:
    """What tells the members of a pair apart; where it needs the contrast of several motions, ``needs`` of them."""

    by: str
    excitations: tuple[str, ...]
    needs: int = 1


def _pair(first: str, second: str, by: str, *excitations: str, needs: int = 1) -> tuple[frozenset[str], Distinction]:
    return frozenset((first, second)), Distinction(by, excitations, needs)


_END_STOP = "an end stop is where it is, whatever the encoder counts and gravity pulls"
_TRACKER = "joints never show the camera: compare a resting cube with a moving one"

DISTINCTIONS: dict[frozenset[str], Distinction] = dict(
    (
        _pair("action_delay", "viscous_friction", "over a chirp, a delay turns the phase and damping takes amplitude too",
              "fast_sweeps", "chirps"),
        _pair("action_delay", "backlash", "a gap matters less the larger the motion, a delay does not",
              "joint_limits", "chirps"),
        _pair("action_delay", "velocity_filter", "a filter leaves positions on time", "chirps", "joint_limits"),
        _pair("action_delay", "timing_jitter", "jitter differs from command to command", "chirps", "oscillations"),
        _pair("action_delay", "tracking_latency", _TRACKER, "chirps", "slide_cube", needs=2),
        _pair("viscous_friction", "backlash", "a gap acts just after a reversal only", "joint_limits", "chirps"),
        _pair("viscous_friction", "safety_damping", "the driver's damping changes the applied torque that is logged",
              "joint_limits", "fast_sweeps"),
        _pair("velocity_filter", "safety_damping", "a filter is late, a gain is not", "chirps", "joint_limits"),
        _pair("coulomb_friction", "viscous_friction", "slow and fast motion together: only one grows with speed",
              "fast_sweeps", "slow_ramps", needs=2),
        _pair("coulomb_friction", "stribeck_friction", "near standstill they add up, in fast motion one is gone",
              "slow_ramps", "fast_sweeps", needs=2),
        _pair("stribeck_friction", "viscous_friction", "one is gone at speed, the other at rest",
              "fast_sweeps", "slow_ramps", needs=2),
        _pair("coulomb_friction", "directional_friction", "both directions at the same speed", "chirps", "joint_limits"),
        _pair("coulomb_friction", "load_friction", "the same speed under little and much load", "fast_sweeps", "oscillations"),
        _pair("coulomb_friction", "backlash", "friction acts all along, a gap after reversals", "chirps", "joint_limits"),
        _pair("torque_constant", "load_friction", "lifting against lowering: friction turns round with the speed",
              "fast_sweeps", "oscillations"),
        _pair("torque_constant", "link_mass", "inertia and gravity differ by pose, a gain does not",
              "fast_sweeps", "oscillations"),
        _pair("torque_constant", "torque_saturation", "a limit cuts large torques only", "fast_sweeps", "oscillations"),
        _pair("torque_constant", "thermal_derating", "the same motion cold and warm",
              "fast_sweeps", "oscillations", "hold_poses"),
        _pair("torque_constant", "position_gain", "torque chirps go past the position controller", "joint_limits", "chirps"),
        _pair("position_gain", "joint_stiffness", "a controller pulls to its target, a spring to its own place", "joint_limits"),
        _pair("thermal_derating", "torque_saturation", "heat has a time constant and goes away at rest, a limit cuts at once",
              "hold_poses", "fast_sweeps", needs=2),
        _pair("thermal_derating", "supply_sag", "heat builds up in one motor, a supply sags with all of them",
              "oscillations", "hold_poses"),
        _pair("torque_saturation", "supply_sag", "one motor at a time against all together", "oscillations", "fast_sweeps"),
        _pair("encoder_offset", "gravity", _END_STOP, "joint_limits", "hold_poses"),
        _pair("encoder_offset", "table_tilt", "a tilt moves all fingers and the cube alike, and no end stop",
              "joint_limits", "hold_poses"),
        _pair("encoder_offset", "backlash", _END_STOP, "joint_limits"),
        _pair("encoder_offset", "joint_stiffness", _END_STOP, "joint_limits"),
        _pair("encoder_offset", "cogging", _END_STOP, "joint_limits"),
        _pair("encoder_offset", "directional_friction", "two ways to the same place: an offset has no direction", "joint_limits"),
        _pair("gravity", "table_tilt", "a tilt moves the table with the fingers", "joint_limits", "slide_cube"),
        _pair("gravity", "joint_stiffness", "a spring is linear in the angle, gravity follows its sine",
              "joint_limits", "fast_sweeps"),
        _pair("gravity", "link_mass", "gravity changes weight without inertia", "joint_limits", "fast_sweeps"),
        _pair("rotor_inertia", "link_mass", "a link couples the joints and weighs, a rotor does neither",
              "chirps", "joint_limits"),
        _pair("cube_mass", "table_friction", "free sliding shows friction alone, a push their product", "slide_cube"),
        _pair("cube_mass", "fingertip_friction", "pushes at slant angles slip, straight ones do not", "slide_cube"),
        _pair("table_friction", "fingertip_friction", "after the push only the table acts", "slide_cube"),
        _pair("cube_size", "tracking_scale", "where a finger touches the side does not depend on the camera", "slide_cube"),
        _pair("cube_size", "tracking_offset", "where a finger touches the side does not depend on the camera", "slide_cube"),
        _pair("tracking_scale", "tracking_offset", "poses far apart: a scale grows with the distance, an offset does not",
              "slide_cube"),
        _pair("tracking_latency", "tracking_offset", _TRACKER, "slide_cube"),
        _pair("tracking_dropout", "tracking_jitter", "repeated poses against the times of reports", "slide_cube", "hold_poses"),
        _pair("tracking_dropout", "tracking_rate", "many reports: chance repeats some, a rate spaces all", "slide_cube"),
    )
)  # fmt: skip
"""Pairs that one motion alone may confuse."""

FOLLOWED: dict[str, tuple[str, tuple[str, ...]]] = {
    "load against motion": ("lifting and lowering the same load", ("fast_sweeps", "oscillations")),
    "time since reversal": ("many reversals, slow and quick ones", ("oscillations", "slow_ramps")),
    "acceleration": ("the same way with other accelerations", ("chirps", "fast_sweeps")),
    "velocity": ("slow and fast motion over the same way", ("slow_ramps", "fast_sweeps")),
    "position": ("the whole range, moving and at rest", ("joint_limits", "hold_poses")),
    "torque": ("torques apart from motion, and loads at rest", ("chirps", "hold_poses")),
    "heat": ("loads at rest until the motors are warm, more than once", ("hold_poses", "oscillations")),
    "time": ("the same motion again, to see whether it drifts or comes back", ("hold_poses", "oscillations")),
}
"""By what an unexplained residual follows: the contrast that shows it, and excitations that hold it."""
