"""What blind tests hide in simulated robots, in the order in which their seeds draw it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Hidden:
    """One number of an effect; how large it is hidden follows from its detection limit, the side from the catalogue's bounds.

    Attributes:
        key: "effect.parameter".
        joints: where it may be; any joint if empty.
        axis: of a number with one value for each axis.
        only_up: whether it is hidden upwards alone, although it may have either sign.
        is_whole: whether it has no size: it is there or not.
        comes_in_time: whether it comes in the middle of a session, and only in those after which a robot finds its zero again.
        beside: other numbers of the same joint, as shares of this one: no real robot has one without the other.
        drawn: a parameter that decides how it looks, with the least and largest value that it is drawn from.
    """

    key: str
    joints: tuple[int, ...] = ()
    axis: int = 0
    only_up: bool = False
    is_whole: bool = False
    comes_in_time: bool = False
    beside: tuple[tuple[str, float], ...] = ()
    drawn: tuple[str, float, float] | None = None

    @property
    def effect(self) -> str:
        """Name in the catalogue."""
        return self.key.partition(".")[0]


_REAL_FRICTION = (("stribeck_friction.extra_nm", 0.03), ("directional_friction.difference_nm", 0.02))
"""Friction is larger near standstill, and not the same in both directions."""

AT_JOINTS: Mapping[str, Hidden] = {
    hidden.key: hidden
    for hidden in (
        Hidden("action_delay.delay_s"),
        Hidden("action_noise.white_nm"),
        Hidden("backlash.gap_rad"),
        Hidden("cogging.amplitude_nm", drawn=("cogging.phase_rad", -np.pi, np.pi)),
        Hidden("coulomb_friction.torque_nm", beside=_REAL_FRICTION),
        Hidden("encoder_quantisation.step_rad"),
        Hidden("joint_noise.position_rad"),
        Hidden("joint_noise.torque_nm"),
        Hidden("joint_noise.velocity_rad_s"),
        Hidden("joint_stiffness.stiffness_nm_rad", drawn=("joint_stiffness.reference_rad", -2.0, 0.5)),
        Hidden("load_friction.coefficient"),
        Hidden("rotor_inertia.armature_kg_m2"),
        Hidden("stribeck_friction.extra_nm", drawn=("stribeck_friction.speed_rad_s", 0.05, 0.25)),
        Hidden("supply_sag.loss_per_nm"),
        Hidden("thermal_derating.loss_per_k", drawn=("thermal_derating.time_constant_s", 4.0, 20.0)),
        Hidden("timing_jitter.std_s"),
        Hidden("velocity_filter.time_constant_s"),
        Hidden("viscous_friction.damping_nm_s_rad"),
        Hidden("torque_constant.error"),
        Hidden("torque_saturation.limit_nm"),
        Hidden("directional_friction.difference_nm"),
        Hidden("link_mass.factor"),
        Hidden("encoder_offset.offset_rad"),
        Hidden("joint_limits.lower_rad", joints=(0, 1, 3, 4, 6, 7), only_up=True),  # inwards: outwards a soft limit holds
        Hidden("table_tilt.roll_rad"),
        Hidden("gravity.offset_m_s2", axis=2),
        Hidden("position_gain.factor"),
        Hidden("safety_damping.factor"),
        Hidden("stuck_joint.holding_torque_nm", is_whole=True),
        Hidden("encoder_jump.offset_rad", comes_in_time=True),
        Hidden("controller_restart.off", is_whole=True),
    )
}
"""By key: one number of every effect that logs of joints can show, three of the sensors' noise."""

OF_CUBE: Mapping[str, str] = {
    key.partition(".")[0]: key
    for key in (
        "tracking_latency.extra_s",
        "tracking_dropout.probability",
        "tracking_offset.position_m",
        "orientation_jumps.probability",
        "cube_mass.factor",
        "fingertip_friction.coefficient",
        "table_friction.coefficient",
    )
}
"""By effect: the number of each effect that logs of a cube and its tracker can show."""

BESIDE_CUBE = (
    ("torque_constant.error", 0.05),
    ("encoder_offset.offset_rad", 0.006),
    ("link_mass.factor", 1.06),
    ("coulomb_friction.torque_nm", 0.015),
    ("backlash.gap_rad", 0.006),
)
"""Errors of one joint: what the other part of the tool is to name, and this one not as a cube's doing."""
