"""What is known of the effects on a cube and its tracker: which numbers of a session each one moves, and what replays try of it.

A session is a vector of numbers and two counts (``subjects/cube/summary.py``). Rows come in the order in which they are asked.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from sim_backend.trifinger import constants as c


class Kind(StrEnum):
    """What an effect shows in: gains of each kind scatter in their own way over healthy sessions, those of pushes widest."""

    TRACKER = "tracker"
    COUNTS = "counts"
    PUSHES = "pushes"


class Count(StrEnum):
    """What is counted in a session."""

    LOST_FRAMES = "lost frames"
    JUMPS = "jumps"


@dataclass(frozen=True)
class Linear:
    """An effect that moves the session's numbers in proportion to its own.

    Attributes:
        effect: name in the catalogue.
        kind: what it shows in.
        parameters: name, place and unit of each of its numbers.
        moves: by how much each moves which number of the session, per unit.
        from_replays: names of trials whose response is added to each, None for none.
        nominal: value of its numbers in a nominal robot.
        usual: what healthy robots have of it beyond that, the middle of its range in ``healthy_cubes.toml``.
        is_rate: whether the number is one over what is moved.
        is_more: whether its numbers can only add to what healthy robots have: less noise than usual is no fault.
        is_place: whether the first two numbers are read off tables from replays, and the third is a height.
    """

    effect: str
    kind: Kind
    parameters: tuple[tuple[str, str, str], ...]
    moves: tuple[Mapping[str, float], ...]
    from_replays: tuple[str | None, ...] = ()
    nominal: float = 0.0
    usual: float = 0.0
    is_rate: bool = False
    is_more: bool = False
    is_place: bool = False


@dataclass(frozen=True)
class Tabled:
    """An effect whose values are tried in replays of pushes, about 1: its parameter, and where it acts."""

    effect: str
    parameter: str
    where: str
    tried: tuple[float, ...]


@dataclass(frozen=True)
class Counted:
    """An effect by chance, whose probability shows as a count."""

    effect: str
    count: Count

    @property
    def key(self) -> str:
        """Of its probability: "effect.parameter"."""
        return f"{self.effect}.probability"


LINEAR = (
    Linear("tracking_latency", Kind.TRACKER, (("extra_s", "camera", "s"),), ({"delay_s": 1.0},)),
    Linear("tracking_jitter", Kind.TRACKER, (("std_s", "camera", "s"),), ({"log_delay_std": 1.0},), is_more=True),
    Linear("tracking_rate", Kind.TRACKER, (("rate_hz", "camera", "Hz"),), ({"log_interval": 1.0},), is_rate=True),
    Linear(
        "tracking_noise",
        Kind.TRACKER,
        (("position_m", "camera", "m"), ("rotation_rad", "camera", "rad")),
        ({"log_noise_m": 1.0}, {"log_noise_rad": 1.0}),
        is_more=True,
    ),
    Linear("colour_segmentation", Kind.TRACKER, (("missed", "camera", ""),), ({"confidence": -0.7},), usual=0.03),
    Linear(
        "tracking_offset",
        Kind.PUSHES,
        (("position_m", "x", "m"), ("position_m", "y", "m"), ("position_m", "z", "m")),
        ({}, {}, {"rest_height_m": 1.0}),
        ("tracking_offset_x", "tracking_offset_y", None),
        is_place=True,
    ),
    Linear(
        "tracking_scale",
        Kind.PUSHES,
        (("factor_error", "camera", ""),),
        ({"rest_height_m": c.CUBE_REST_HEIGHT_M},),
        ("tracking_scale",),
    ),
    Linear(
        "cube_size",
        Kind.PUSHES,
        (("factor", "cube", ""),),
        ({"rest_height_m": c.CUBE_REST_HEIGHT_M},),
        ("cube_size",),
        nominal=1.0,
    ),
)
TABLED = (
    Tabled("cube_mass", "factor", "cube", (0.5, 0.8, 1.25, 1.6)),
    Tabled("table_friction", "coefficient", "table", (0.35, 0.7, 0.9, 1.15, 1.4)),
    Tabled("fingertip_friction", "coefficient", "cube", (0.5, 0.8, 1.2, 1.5)),
)
COUNTED = (Counted("tracking_dropout", Count.LOST_FRAMES), Counted("orientation_jumps", Count.JUMPS))

KINDS: Mapping[Kind, tuple[str, ...]] = {
    Kind.TRACKER: tuple(row.effect for row in LINEAR if row.kind is Kind.TRACKER),
    Kind.COUNTS: tuple(row.effect for row in COUNTED),
    Kind.PUSHES: (*(row.effect for row in LINEAR if row.kind is Kind.PUSHES), *(row.effect for row in TABLED)),
}
"""Effects by what they show in."""
OFFSET, SCALE = "tracking_offset", "tracking_scale"
"""Of those that pushes show, the tracker's; the others are factors of the robot's physics."""
SIZE = "cube_size"
"""What the height of a cube at rest goes by."""
NUMBERS_OF_PUSHES: Mapping[str, tuple[tuple[str, str, str], ...]] = {
    **{row.effect: row.parameters for row in LINEAR if row.kind is Kind.PUSHES},
    **{row.effect: ((row.parameter, row.where, ""),) for row in TABLED},
}
"""Name, place and unit of each number of the effects that pushes show."""
PUSHED: Mapping[str, str] = {effect: f"{effect}.{numbers[0][0]}" for effect, numbers in NUMBERS_OF_PUSHES.items()}
"""Key of the parameter of each of them."""
USUAL_SIZES: Mapping[str, float] = {
    "cube_mass": 0.2,
    "table_friction": 0.5,
    "fingertip_friction": 0.5,
    "cube_size": 0.01,
    "tracking_offset": 0.003,
    "tracking_scale": 0.01,
}
"""Standard deviation of the numbers of each before anything is seen, about where it is absent, where several are asked at once:
what may be one or the other is the one that is less far-fetched. Frictions go by dirt and wear, masses by how a cube is filled
and painted; a cube is printed to tenths of a millimetre, and cameras that see it many millimetres off were calibrated badly."""
UNTOLD_BESIDE_OTHERS: Mapping[str, str] = {
    "fingertip_friction": "friction of the fingertips beside that of the table: pushes look much alike with either",
}
"""What is not named where several are asked at once, and what is said of it: at two robots of ``real`` it was 0.28 in place of
0.86 and of 1.06."""
HYPOTHESES = (*(row.effect for row in LINEAR), *(row.effect for row in TABLED), *(row.effect for row in COUNTED))


REPLAYED = frozenset(
    {
        "torque_constant",
        "torque_saturation",
        "supply_sag",
        "cogging",
        "backlash",
        "coulomb_friction",
        "viscous_friction",
        "stribeck_friction",
        "load_friction",
        "directional_friction",
        "stuck_joint",
        "link_mass",
        "rotor_inertia",
        "joint_stiffness",
        "joint_limits",
        "table_tilt",
        "gravity",
    }
)
"""What was found of a robot's mechanics and goes into the replay of pushes. Not chance and filters; nor heat, as nobody knows how
warm a motor is when a push begins."""
ENCODER_OFFSET, DELAY = "encoder_offset.offset_rad", "action_delay.delay_s"
"""What goes into the positions and the torques that are replayed: a replay begins without any torque on its way."""


@dataclass(frozen=True)
class Trial:
    """One thing to try in a replay: physics of the cube, or an error of the tracker, at one value."""

    effect: str
    value: float
    physics: Mapping[str, float]
    bias_m: tuple[float, float] = (0.0, 0.0)
    scale: float = 0.0


def _tried(effect: str, parameter: str, values: Sequence[float]) -> tuple[Trial, ...]:
    return tuple(Trial(effect, value, {f"{effect}.{parameter}": value}) for value in values)


_OFFSETS_M = (-0.008, -0.004, 0.004, 0.008)
NOMINAL = Trial("nominal", 0.0, {})
TRIALS: tuple[Trial, ...] = (
    NOMINAL,
    *(trial for row in TABLED for trial in _tried(row.effect, row.parameter, row.tried)),
    *_tried("cube_size", "factor", (1.03,)),
    *(Trial("tracking_offset_x", offset, {}, bias_m=(offset, 0.0)) for offset in _OFFSETS_M),
    *(Trial("tracking_offset_y", offset, {}, bias_m=(0.0, offset)) for offset in _OFFSETS_M),
    Trial("tracking_scale", 0.02, {}, scale=0.02),
)
"""All that each push is replayed with."""

UNSURE: Mapping[tuple[str, float], float] = {
    ("tracking_offset_x", 0.004): 0.125,
    ("tracking_offset_y", 0.004): 0.125,
    ("cube_mass", 1.25): 0.08,
    ("table_friction", 0.9): 0.2,
    ("fingertip_friction", 0.8): 0.1,
}
"""Shares of these trials' responses that a healthy push may differ by: where it is touched by half a millimetre, its mass and
friction by 2 %. Where a response is large, as at an impact, a residual says less."""

DIRECTIONS: Mapping[str, tuple[tuple[str, float], tuple[str, float] | None]] = {
    "cube_mass": (("cube_mass", 1.25), ("cube_mass", 0.8)),
    "table_friction_low": (("table_friction", 0.9), None),
    "table_friction_high": (("table_friction", 1.15), None),
    "table_friction_far": (("table_friction", 0.7), None),
    "fingertip_friction_low": (("fingertip_friction", 0.8), None),
    "fingertip_friction_high": (("fingertip_friction", 1.2), None),
    "cube_size": (("cube_size", 1.03), None),
    "tracking_offset_x": (("tracking_offset_x", 0.004), None),
    "tracking_offset_y": (("tracking_offset_y", 0.004), None),
    "tracking_scale": (("tracking_scale", 0.02), None),
}
"""Directions that the residuals of pushes are looked at in: what one trial changes, or one more than another."""
