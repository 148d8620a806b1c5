"""What separates two effects that look alike in some motion: the only table of pairs.

Pairs at joints are decided by a simulation (``python -m sim_backend.reality_gap.bench.separating``, kept in ``results``): of two
effects at twice their detection limits, how much of the smaller change in what is measured the other one cannot give. A pair
names the two excitations in which most of it is left, the best first, or the motions whose contrast tells it (``needs``). Pairs
at the cube are decided by its blind test: of 30 robots it never confused the cube's mass with the friction of the fingertips, and
6 times with that of the table.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Separation:
    """What tells the members of a pair apart; where it needs the contrast of several motions, ``needs`` of them."""

    by: str
    excitations: tuple[str, ...]
    needs: int = 1


def _pair(first: str, second: str, by: str, *excitations: str, needs: int = 1) -> tuple[frozenset[str], Separation]:
    return frozenset((first, second)), Separation(by, excitations, needs)


_END_STOP = "an end stop is where it is, whatever the encoder counts and gravity pulls"
_TRACKER = "joints never show the camera: compare a resting cube with a moving one"

SEPARATIONS: dict[frozenset[str], Separation] = dict(
    (
        _pair("action_delay", "viscous_friction", "over a chirp, a delay turns the phase and damping takes amplitude too",
              "fast_sweeps", "chirps"),
        _pair("action_delay", "backlash", "a gap matters less the larger the motion, a delay does not", "chirps", "joint_limits"),
        _pair("action_delay", "velocity_filter", "a filter leaves positions on time", "joint_limits", "chirps"),
        _pair("action_delay", "timing_jitter", "jitter differs from command to command", "chirps", "fast_sweeps"),
        _pair("action_delay", "tracking_latency", _TRACKER, "chirps", "slide_cube", needs=2),
        _pair("viscous_friction", "backlash", "a gap acts just after a reversal only", "chirps", "fast_sweeps"),
        _pair("viscous_friction", "safety_damping", "the driver's damping changes the applied torque that is logged",
              "joint_limits", "chirps"),
        _pair("velocity_filter", "safety_damping", "a filter is late, a gain is not", "chirps", "fast_sweeps"),
        _pair("coulomb_friction", "viscous_friction", "slow and fast motion together: only one grows with speed",
              "fast_sweeps", "slow_ramps", needs=2),
        _pair("coulomb_friction", "stribeck_friction", "near standstill they add up, in fast motion one is gone",
              "slow_ramps", "fast_sweeps", needs=2),
        _pair("stribeck_friction", "viscous_friction", "one is gone at speed, the other at rest",
              "fast_sweeps", "slow_ramps", needs=2),
        _pair("coulomb_friction", "directional_friction", "both directions at the same speed", "joint_limits", "chirps"),
        _pair("coulomb_friction", "load_friction", "the same speed under little and much load", "joint_limits", "chirps"),
        _pair("coulomb_friction", "backlash", "friction acts all along, a gap after reversals", "chirps", "joint_limits"),
        _pair("torque_constant", "load_friction", "lifting against lowering: friction turns round with the speed",
              "joint_limits", "chirps"),
        _pair("torque_constant", "link_mass", "inertia and gravity differ by pose, a gain does not", "joint_limits", "chirps"),
        _pair("torque_constant", "torque_saturation", "a limit cuts large torques only", "chirps", "fast_sweeps"),
        _pair("torque_constant", "thermal_derating", "the same motion cold and warm", "chirps", "fast_sweeps"),
        _pair("torque_constant", "position_gain", "torque chirps go past the position controller", "joint_limits", "chirps"),
        _pair("position_gain", "joint_stiffness", "a controller pulls to its target, a spring to its own place",
              "joint_limits", "chirps"),
        _pair("thermal_derating", "torque_saturation", "heat has a time constant and goes away at rest, a limit cuts at once",
              "chirps", "fast_sweeps"),
        _pair("thermal_derating", "supply_sag", "heat builds up in one motor, a supply sags with all of them",
              "fast_sweeps", "chirps"),
        _pair("torque_saturation", "supply_sag", "one motor at a time against all together", "chirps", "fast_sweeps"),
        _pair("encoder_offset", "gravity", "two poses far apart, or an end stop: it is where it is, whatever the encoder counts",
              "joint_limits", "chirps"),
        _pair("encoder_offset", "table_tilt", "two poses far apart: a tilt turns gravity for all joints alike, and no end stop",
              "joint_limits", "fast_sweeps"),
        _pair("encoder_offset", "backlash", _END_STOP, "chirps", "joint_limits"),
        _pair("encoder_offset", "joint_stiffness", _END_STOP, "joint_limits", "fast_sweeps"),
        _pair("encoder_offset", "cogging", _END_STOP, "joint_limits", "hold_poses"),
        _pair("encoder_offset", "directional_friction", "two ways to the same place: an offset has no direction",
              "joint_limits", "chirps"),
        _pair("gravity", "table_tilt", "a tilt turns gravity and leaves its size; a level on the table shows the rest",
              "joint_limits", "fast_sweeps"),
        _pair("gravity", "joint_stiffness", "a spring is linear in the angle, gravity follows its sine",
              "joint_limits", "fast_sweeps"),
        _pair("gravity", "link_mass", "gravity changes weight without inertia", "fast_sweeps", "joint_limits"),
        _pair("rotor_inertia", "link_mass", "a link couples the joints and weighs, a rotor does neither",
              "joint_limits", "chirps"),
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


def separated_by(first: str, second: str, otherwise: str) -> str:
    """What tells two effects apart, in words; ``otherwise`` of a pair that nothing is known of."""
    known = SEPARATIONS.get(frozenset((first, second)))
    return otherwise if known is None else known.by
