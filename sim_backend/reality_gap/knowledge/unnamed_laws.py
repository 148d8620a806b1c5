"""Laws that the catalogue lacks and that causes are mistaken for, and what two effects of all joints say alike; an entry each."""

from dataclasses import dataclass

ZERO, DRAG = "torque.zero_nm", "drag.nm_s2_rad2"
"""Numbers of no effect: a torque that is always there, and drag by the square of speed."""
BRAKING = "motor.braking_share"
"""By which share a motor's own voltage takes more torque than is said: its square of torque constant over resistance is off."""
GIVE, CREEP = "bearing.give_rad", "bearing.creep_rad_s"
"""How far a bearing gives before it slips, and how fast it creeps under all of its friction.

Prandtl's element of a spring and dry friction in series, with a damper in that series (L. Prandtl, Ein Gedankenmodell zur
kinetischen Theorie der festen Koerper, ZAMM 8, 1928, pages 85 to 106). Healthy robots have both, dry friction alone has neither.
"""
BEARING = frozenset({GIVE, CREEP})
LINK_INERTIA = "link.inertia_share"
LINK_CENTRES = ("link.centre_x_m", "link.centre_y_m", "link.centre_z_m")
"""By how much a model's links are off in inertia and in their centres of mass, for each joint."""
MASS, CONSTANT = ("link_mass", "factor"), ("torque_constant", "error")
"""Of all joints by one share they are the same motion."""

ONE_WAY = ("coulomb_friction", "stribeck_friction", "load_friction")
"""Frictions that are a constant torque where a joint moves one way alone."""
DRY = frozenset({*ONE_WAY, "directional_friction"})
"""Frictions whose torque turns about with a joint: how it sets in again is each robot's own, and each simulator's."""


@dataclass(frozen=True)
class UnnamedLaw:
    """A law without a name in the catalogue.

    Attributes:
        probes: of its numbers at one joint, each with what it is probed by: a number of the catalogue of which it is a hundredth
            of the scale, or an amount.
        said: what it is.
        mistaken: effects that it may be mistaken for.
        separated_by: what to record.
        alike: those of them that are the same while a joint moves: which fits better tells how it sticks, not which it is.
        of_voltage: whether only motors have it that are driven by voltage.
    """

    probes: tuple[tuple[str, str | float], ...]
    said: str
    mistaken: frozenset[str]
    separated_by: str
    alike: frozenset[str] = frozenset()
    of_voltage: bool = False


LAWS = (
    UnnamedLaw(
        ((DRAG, "viscous_friction.damping_nm_s_rad"),),
        "drag that grows with the square of speed",
        frozenset({"coulomb_friction", "viscous_friction", "stribeck_friction", "load_friction", "directional_friction"}),
        "each joint slowly and as fast as it goes",
    ),
    UnnamedLaw(
        ((ZERO, "coulomb_friction.torque_nm"),),
        "a torque that is always there, such as where a sensor's zero is off",
        frozenset(
            {
                *("directional_friction", "joint_stiffness", "encoder_offset", "table_tilt"),
                *("gravity", "link_mass", "torque_constant"),
                *ONE_WAY,
            }
        ),
        "the torques of joints at rest, hanging and with their motors off, and motions both ways",
        alike=frozenset({"directional_friction", *ONE_WAY}),
    ),
    UnnamedLaw(
        ((".".join(MASS), ".".join(MASS)), (LINK_INERTIA, 1.0), *((key, 1e-3) for key in LINK_CENTRES)),
        "a link whose mass lies elsewhere, such as with a tool on it",
        frozenset({"torque_constant", "rotor_inertia", "encoder_offset", "joint_stiffness"}),
        "the links weighed, with their centres of mass, or the same motion without what is mounted on them",
    ),
    UnnamedLaw(
        tuple((key, 1e-3) for key in LINK_CENTRES),
        "a link whose centre of mass is not where the model has it",
        frozenset({"link_mass", "gravity", "table_tilt"}),
        "each link balanced on an edge, or quick motions, whose inertia tells a centre of mass from a mass",
    ),
    UnnamedLaw(
        ((BRAKING, 0.01),),
        "a motor whose own voltage brakes it more or less than its torque constant and resistance say",
        frozenset(
            {
                *("position_gain", "action_delay", "torque_constant", "torque_saturation"),
                *("coulomb_friction", "viscous_friction", "stribeck_friction", "load_friction", "directional_friction"),
            }
        ),
        "the speed of the motor without load, and its torque at standstill, each at a known voltage",
        of_voltage=True,
    ),
)
