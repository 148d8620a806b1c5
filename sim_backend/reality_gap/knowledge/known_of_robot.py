"""What is known of the robot that was recorded: a TriFinger of the farm's kind, or any robot, of which there is only a model.

Wherever a study of joints relies on more than recordings and model it asks this object. Which of the two it is follows from
where the recordings come from: anybody's data have a study file, the farm's logs have none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.knowledge.healthy import NO_SESSIONS, HealthySessions, healthy_sessions
from sim_backend.reality_gap.recording import Recording

CUTOFF_HZ = 25.0
"""Below it joints are followed; encoder noise grows with the square of the frequency."""
_LOAD_SHARES = (0.3, 0.5, 0.7, 0.85, 0.95)


@dataclass(frozen=True)
class KnownTriFinger:
    """A TriFinger: its driver's pipeline, its motors, rotors and sensors, where its joints end, and its healthy sessions.

    Attributes:
        healthy: sessions recorded under what its own were recorded under.
        found: what a study of its joints has named, so that what comes after it need not take that for something else.
        differs_everywhere: whether that is so much that cube and tracker are expected to have several causes, too.
        cutoff_hz: below which torques are compared.
        granted: share of a healthy robot's tolerances that this one may have.
        load_shares: of the largest torque that was sent, where a motor's limit is looked for.
        pattern_share: of what many causes explain, that what is left must reach to be more than the shape of their laws.
        pattern_share_of_few: the same where few causes act. Of 250 robots with an effect of up to 5 detection limits and 17 with
            one of 30, none with the right name left more than 25 nats of its mechanics.
    """

    healthy: HealthySessions
    found: Physics = field(default_factory=Physics.nominal)
    differs_everywhere: bool = False
    cutoff_hz: ClassVar[float] = CUTOFF_HZ
    granted: ClassVar[float] = 1.0
    load_shares: ClassVar[tuple[float, ...]] = _LOAD_SHARES
    pattern_share: ClassVar[float] = 0.3
    pattern_share_of_few: ClassVar[float] = 0.05

    @classmethod
    def seen_in(cls, recordings: Sequence[Recording]) -> "KnownTriFinger":
        """The robot of some recordings."""
        return cls(healthy_sessions(tuple(recording.regime for recording in recordings)))

    @staticmethod
    def prior_share(counted_s: float, long_s: float) -> float:
        """As of :class:`UnknownRobot`: tolerances were measured on healthy robots, and stay whatever was recorded."""
        del counted_s, long_s
        return 1.0


@dataclass(frozen=True)
class Tolerance:
    """By how much a robot that nothing is wrong with may differ from its model: shares of the model's own values.

    They are twice the standard deviation. Nobody's model is exact: without them a mass that is 1 % off would be called friction.
    Bearings have no such number in a model, whose dry friction holds still: balls and seals give and creep before they slip
    (B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30, 1994, pages 1083 to 1138).

    Attributes:
        mass: of each link, its inertia with it.
        inertia: of each link beside its mass, and of each rotor.
        centre: of mass, as a share of its distance from the link's joint.
        friction: of the friction and the damping that the model has.
        zero: of recorded torques, of the largest of each joint: sensors and amplifiers have a zero of their own.
        give_rad: how far a bearing gives before it slips, rad.
        creep_rad_s: how fast it creeps under all of its friction before it slips, rad/s.
    """

    mass: float = 0.02
    inertia: float = 0.05
    centre: float = 0.02
    friction: float = 0.05
    zero: float = 0.01
    give_rad: float = 0.001
    creep_rad_s: float = 0.01


@dataclass(frozen=True)
class UnknownRobot:
    """Any other robot: its nominal model is all that is known of it. Attributes are those of :class:`KnownTriFinger`.

    Nobody knows what its motor boards do, so that torques are compared below a lower frequency only, nor what its driver may ask
    of the motors, so that a limit is looked for further down. What is left must be more than what was explained.
    """

    tolerance: Tolerance = field(default_factory=Tolerance)
    healthy: ClassVar[HealthySessions] = NO_SESSIONS
    cutoff_hz: ClassVar[float] = 12.0
    granted: ClassVar[float] = 0.2
    load_shares: ClassVar[tuple[float, ...]] = (0.05, 0.1, 0.2, *_LOAD_SHARES)
    pattern_share: ClassVar[float] = 1.0
    pattern_share_of_few: ClassVar[float] = 1.0

    @staticmethod
    def prior_share(counted_s: float, long_s: float) -> float:
        """By how much a prior's standard deviation shrinks, so that it is not swamped by many rows.

        Args:
            counted_s: how long the rows last together.
            long_s: up to where it stays.
        """
        return float(min(1.0, np.sqrt(long_s / max(counted_s, long_s))))


Robot = KnownTriFinger | UnknownRobot
