"""What is known of each effect that joints can show: in which equation, how large it may be, how it is probed; an entry each.

Whatever asks for causes at joints asks here: a new effect is an entry, and its law stands with the other laws. The order of the
entries is that of a fit's terms.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import LOOKS


class Channel(StrEnum):
    """Which equation of a joint."""

    CONTROLLER = "controller"
    CURRENT = "current"
    MECHANICS = "mechanics"
    VELOCITY = "velocity"


class Plane(StrEnum):
    """What two numbers mean together, so that two images stand for all of their values."""

    WAVE = "amplitude and phase"
    SPRING = "stiffness and place of rest"


@dataclass(frozen=True)
class Shape:
    """A second parameter that decides how a number looks.

    Attributes:
        key: "effect.parameter".
        values: at which images are taken; each is a hypothesis of its own.
        plane: set where the images of two values stand for any other: both are then one hypothesis.
        scale: prior standard deviation of the parameter itself, which is fitted, too, once the effect is in the model; 0 if not.
        more: values that are also tried where many causes act: something slower hides unless other causes are pinned down.
    """

    key: str
    values: tuple[float, ...]
    plane: Plane | None = None
    scale: float = 0.0
    more: tuple[float, ...] = ()


@dataclass(frozen=True)
class Number:
    """One number that a fit may change.

    Attributes:
        key: "effect.parameter".
        scale: how large a deviation may be before its size speaks against it, a prior's standard deviation in its unit.
        probes: deviations at which the image of a number that is not linear is taken; a hundredth of the scale if empty.
        probed_by: a parameter whose value in the same joint of an unknown robot it cannot be much more than.
        shape: the second parameter that decides how it looks.
        product_with: a parameter, and the value that it is fitted with: only the product with the number shows in motion.
        begins_at_load: whether it is tried at shares of the largest load instead of probes.
        held: its scale while noise is measured, so that it does not explain noise away; 0 if it stays.
        model_field: where a compiled model keeps it as an absolute value of a joint.
        tolerated_as: which of a model's tolerances (``known_of_robot.Tolerance``) its own value of it has.
        samples_off: standard deviation of what of it may come of how an unknown robot samples and writes, in samples.
        beside: a parameter of the same effect and joint that an unknown robot's motions tell together with it.
        form: a parameter of the same effect and joint that says of which form its law is, and the values of those forms that are
            known. An unknown robot's motions are asked which it is once the causes are known.
    """

    key: str
    scale: float
    probes: tuple[float, ...] = ()
    probed_by: str = ""
    shape: Shape | None = None
    product_with: tuple[str, float] | None = None
    begins_at_load: bool = False
    held: float = 0.0
    model_field: str = ""
    tolerated_as: str = ""
    samples_off: float = 0.0
    beside: str = ""
    form: tuple[str, tuple[float, ...]] | None = None


@dataclass(frozen=True)
class JointEffect:
    """An effect that a fit of joints may name.

    Attributes:
        channel: in which its numbers have images; those of the current show in the mechanics where nobody measured the current.
        numbers: that are fitted. Of joints, they are a hypothesis for each one and one for all; of the platform, one together.
        of_the_driver: whether only a robot can have it whose driver is known.
        in_commands: whether the torques that were sent show it, whatever the mechanics.
        scales_everything: whether it makes all torques or all masses different by the same share, of which there is no sign where
            all joints have it: it is only asked of single ones.
        reaches_other_joints: whether the joints before it feel it as much as its own.
        contains: an effect that is the same with fewer numbers.
        plausible_of_many: size beyond which it only hides what is missing where many causes act, in its unit; 0 without limit.
        is_bent: whether its image is so far from a straight line that it seems to gain where another friction acts, also nearby.
    """

    channel: Channel
    numbers: tuple[Number, ...]
    of_the_driver: bool = False
    in_commands: bool = False
    scales_everything: bool = False
    reaches_other_joints: bool = False
    contains: str = ""
    plausible_of_many: float = 0.0
    is_bent: bool = False

    @property
    def effect(self) -> str:
        """Name in the catalogue."""
        return self.numbers[0].key.partition(".")[0]


def _at(channel: Channel, *numbers: Number) -> JointEffect:
    return JointEffect(channel, numbers)


def _sent(number: Number) -> JointEffect:
    return JointEffect(Channel.CONTROLLER, (number,), of_the_driver=True, in_commands=True)


COULOMB_FRICTION, VISCOUS_FRICTION = "coulomb_friction.torque_nm", "viscous_friction.damping_nm_s_rad"
"""What MJCF has of joints' friction, too."""
_ENTRIES = (
    _at(Channel.MECHANICS, Number(COULOMB_FRICTION, 0.05, model_field="dof_frictionloss", tolerated_as="friction")),
    _at(Channel.MECHANICS, Number(VISCOUS_FRICTION, 0.02, model_field="dof_damping", tolerated_as="friction")),
    _at(
        Channel.MECHANICS,
        Number(
            "stribeck_friction.extra_nm",
            0.03,
            shape=Shape("stribeck_friction.speed_rad_s", (0.04, 0.12, 0.35), scale=0.1),
            form=("stribeck_friction.exponent", (1.0, 2.0)),  # Tustin's and the bell of Gauss
        ),
    ),
    _at(Channel.MECHANICS, Number("load_friction.coefficient", 0.15, beside="load_friction.external_coefficient")),
    JointEffect(
        Channel.MECHANICS,
        (Number("directional_friction.difference_nm", 0.03, probes=(-0.01, 0.01), probed_by="coulomb_friction.torque_nm"),),
        is_bent=True,
    ),
    _at(Channel.MECHANICS, Number("backlash.gap_rad", 0.01, probes=(0.003, 0.01, 0.03))),
    JointEffect(
        Channel.CURRENT,
        (Number("action_delay.delay_s", 0.005, probes=(0.001, 0.004, 0.015), samples_off=0.05),),
        in_commands=True,
    ),
    JointEffect(Channel.MECHANICS, (Number("torque_constant.error", 0.1, held=0.02),), scales_everything=True),
    _at(Channel.CURRENT, Number("torque_saturation.limit_nm", 0.2, begins_at_load=True)),
    JointEffect(Channel.CURRENT, (Number("supply_sag.loss_per_nm", 0.2, probes=(0.05, 0.15, 0.4)),), of_the_driver=True),
    _at(
        Channel.MECHANICS,
        Number(
            "thermal_derating.loss_per_k",
            0.005,
            shape=Shape("thermal_derating.time_constant_s", (5.0, 30.0), scale=20.0, more=(300.0,)),
            product_with=("thermal_derating.rise_k_nm2", 2000.0),
        ),
    ),
    _at(Channel.MECHANICS, Number("cogging.amplitude_nm", 0.01, shape=Shape("cogging.phase_rad", (0.0, np.pi / 2), Plane.WAVE))),
    JointEffect(
        Channel.MECHANICS,
        (Number("link_mass.factor", 0.2, held=0.03, tolerated_as="mass"),),
        scales_everything=True,
        reaches_other_joints=True,
    ),
    _at(Channel.MECHANICS, Number("rotor_inertia.armature_kg_m2", 5e-4, model_field="dof_armature", tolerated_as="inertia")),
    _at(
        Channel.MECHANICS,
        Number("joint_stiffness.stiffness_nm_rad", 0.02, shape=Shape("joint_stiffness.reference_rad", (-2.0, 1.0), Plane.SPRING)),
    ),
    _at(Channel.MECHANICS, Number("encoder_offset.offset_rad", 0.02)),
    _at(Channel.VELOCITY, Number("velocity_filter.time_constant_s", 0.005, samples_off=1.0)),
    _sent(Number("position_gain.factor", 0.3)),
    _sent(Number("safety_damping.factor", 0.3)),
    _sent(Number("timing_jitter.std_s", 0.005, probes=(0.0005, 0.001, 0.002, 0.004))),
    _sent(Number("controller_restart.off", 1.0)),
    _at(Channel.MECHANICS, Number("table_tilt.roll_rad", 0.02), Number("table_tilt.pitch_rad", 0.02)),
    JointEffect(Channel.MECHANICS, (Number("gravity.offset_m_s2", 0.1),), contains="table_tilt", plausible_of_many=0.15),
)

FITTED: Mapping[str, JointEffect] = {entry.effect: entry for entry in _ENTRIES}
"""By effect: what a fit of joints may name."""
NUMBERS: Mapping[str, Number] = {number.key: number for entry in _ENTRIES for number in entry.numbers}
"""By "effect.parameter"."""
TURNS_OF_MOTORS = frozenset({"cogging.phase_rad"})
"""Parameters in rad that are no angle of a joint."""
ARMATURE = "rotor_inertia.armature_kg_m2"
"""Inertia of a rotor on the joint's side of its gear; none where a model has none."""
COGGING_AMPLITUDE, COGGING_PHASE = "cogging.amplitude_nm", "cogging.phase_rad"
COGGING_CYCLES = "cogging.cycles_per_rad"
"""How often a motor cogs: of an unknown one it is seen, not fitted."""
MOTOR_LOSS, MOTOR_RISE, MOTOR_WARMS_S = (f"thermal_derating.{name}" for name in ("loss_per_k", "rise_k_nm2", "time_constant_s"))
"""What a warm motor loses, how warm its torque makes it, and within what time."""
JOINT_STIFFNESS, GRAVITY_OFFSET = "joint_stiffness.stiffness_nm_rad", "gravity.offset_m_s2"
"""What draws a joint back; one swing does not tell from how much has to be moved, and how quick a clock is."""
TORQUE_CONSTANT = "torque_constant.error"
"""Of motors: what they make of a current, and of their speed where they are driven by voltage."""
POSITION_GAIN = "position_gain.factor"
"""Of controllers: only rollouts have it where nobody recorded what they sent."""
SHAPES: Mapping[str, Shape] = {number.shape.key: number.shape for number in NUMBERS.values() if number.shape is not None}
"""By the shape's own "effect.parameter"."""
SCALES: Mapping[str, float] = (
    {key: number.scale for key, number in NUMBERS.items()}
    | {key: shape.scale for key, shape in SHAPES.items() if shape.scale > 0.0}
    | {number.beside: number.scale for number in NUMBERS.values() if number.beside}
)
"""Scale of everything that is fitted: numbers, and what is fitted once their effect is in the model: shapes, others beside."""


def scales_everything(effect: str) -> bool:
    """Whether an effect makes all torques, or all masses, different by the same share; not what is not fitted."""
    return effect in FITTED and FITTED[effect].scales_everything


def shape_of(effect: str) -> Shape | None:
    """How a fitted effect may look; None without a shape or of what is not fitted."""
    entry = FITTED.get(effect)
    return None if entry is None else entry.numbers[0].shape


def plane_of(effect: str) -> Plane | None:
    """What the two images of a fitted effect mean together; None where each image stands for itself."""
    shape = shape_of(effect)
    return None if shape is None else shape.plane


def keys_of(channel: Channel) -> tuple[str, ...]:
    """The numbers that have images in an equation."""
    return tuple(number.key for entry in _ENTRIES if entry.channel is channel for number in entry.numbers)


OF_LATE_COLUMNS = ("viscous_friction", "rotor_inertia")
"""What a torque that is written late seems to have less or more of: what goes with the speed, and with its change."""
LATE_TORQUE, LIMITED_TORQUE = "action_delay.delay_s", "torque_saturation.limit_nm"
"""What commanded and measured torque say of a motor without any model of what it moves."""
OFFSET, TILT = ("encoder_offset", "offset_rad"), (("table_tilt", "roll_rad"), ("table_tilt", "pitch_rad"))
TURNED = frozenset({"gravity", "table_tilt"})
"""An encoder's error, and what turns gravity: of the first joint they are one."""
FILTERED_VELOCITY = "velocity_filter.time_constant_s"
"""What positions and velocities say of a sensor."""


class Sign(StrEnum):
    """What joints show without any fit, said without its cause."""

    POSITION_NOISE = "the noise of the reported position"
    VELOCITY_NOISE = "the noise of the reported velocity"
    TORQUE_NOISE = "the noise of the measured torque"
    FELT_TORQUE = "torque that was not sent but felt"
    SLOW_FELT_TORQUE = "slow torque that was not sent but felt"
    POSITION_STEPS = "the steps of the reported position"
    POSITION_JUMP = "a jump of the reported position"
    REST_UNDER_LOAD = "the rest under load"
    RATTLING_ROTOR = "the rattling of the rotor"
    LOWER_END = "the place of the lower end"
    UPPER_END = "the place of the upper end"


SENSOR_NOISE = frozenset({Sign.POSITION_NOISE, Sign.VELOCITY_NOISE, Sign.TORQUE_NOISE})
FELT = frozenset({Sign.FELT_TORQUE, Sign.SLOW_FELT_TORQUE})
ENDS = frozenset({Sign.LOWER_END, Sign.UPPER_END})

SEEN: Mapping[Sign, str] = {
    Sign.POSITION_NOISE: "joint_noise.position_rad",
    Sign.VELOCITY_NOISE: "joint_noise.velocity_rad_s",
    Sign.TORQUE_NOISE: "joint_noise.torque_nm",
    Sign.FELT_TORQUE: "action_noise.white_nm",
    Sign.SLOW_FELT_TORQUE: "action_noise.correlated_nm",
    Sign.POSITION_STEPS: "encoder_quantisation.step_rad",
    Sign.POSITION_JUMP: "encoder_jump.offset_rad",
    Sign.REST_UNDER_LOAD: "stuck_joint.holding_torque_nm",
    Sign.RATTLING_ROTOR: "backlash.gap_rad",
    Sign.LOWER_END: "joint_limits.lower_rad",
    Sign.UPPER_END: "joint_limits.upper_rad",
}
"""The parameter that each sign tells the value of."""


def effect_of(sign: Sign) -> str:
    """Name in the catalogue of what a sign tells."""
    return SEEN[sign].partition(".")[0]


TAKES_OVER: Mapping[Sign, str] = {Sign.POSITION_JUMP: "encoder_offset"}
"""Effects that a fit would name for what a sign has told already."""
NOT_ASKED: Mapping[str, str] = {
    "joint_episode_noise": "an error that lasts for an episode is an offset of the encoder in that episode",
    "finger_table_friction": "no excitation touches the table",
    "cube_pushes": "forces by chance leave no motion that comes again",
    "tracking_episode_noise": "an error that lasts for an episode is an offset of the tracker in that episode",
    "observation_noise": "it is the tracker's noise once more, and the two add up",
    "occlusion_by_fingers": "lost frames are counted wherever the fingers are",
    "foreign_occlusion": "lost frames are counted wherever the cube is",
    "dead_camera": "a tracker of two cameras reports as one of three does, with more noise",
    **{effect.name: "it changes images and no number of a log" for effect in CATALOGUE.values() if effect.acts in LOOKS},
}
"""Effects that no subject is asked for, and why."""
