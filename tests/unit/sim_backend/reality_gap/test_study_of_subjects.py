"""What one subject of a study leaves to the next."""

import pytest

from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.knowledge.healthy import healthy_sessions
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, UnknownRobot
from sim_backend.reality_gap.study import knowing
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind
from sim_backend.trifinger.constants import JOINT_NAMES

KEY = "coulomb_friction.torque_nm"
CAUSE = Cause("coulomb_friction", "torque_nm", JOINT_NAMES[4], 0.03, "N m", (0.028, 0.032))


def test_what_was_named_at_joints_is_known_when_the_cube_is_asked():
    known = knowing(KnownTriFinger(healthy_sessions()), Verdict(VerdictKind.NAMED, "friction", (CAUSE,)))
    assert isinstance(known, KnownTriFinger)
    assert known.found.value(KEY)[0].tolist() == [0.0] * 4 + [0.03] + [0.0] * 4


@pytest.mark.parametrize("kind", [kind for kind in VerdictKind if kind is not VerdictKind.NAMED])
def test_what_is_not_sure_is_not_known(kind):
    known = KnownTriFinger(healthy_sessions(), Physics.of(1, {"action_delay.delay_s": 0.002}))
    assert knowing(known, Verdict(kind, "one of two", (CAUSE,))) == known
    assert knowing(UnknownRobot(), Verdict(VerdictKind.NAMED, "friction", (CAUSE,))) == UnknownRobot()


def of_effects(*effects: str, half: float = 1e-4) -> Verdict:
    causes = [Cause(effect, *NUMBERS[effect], (NUMBERS[effect][2] - half, NUMBERS[effect][2] + half)) for effect in effects]
    return Verdict(VerdictKind.NAMED, "many", tuple(causes))


NUMBERS = {
    "coulomb_friction": ("torque_nm", JOINT_NAMES[0], 0.04, "N m"),
    "load_friction": ("coefficient", JOINT_NAMES[1], 0.05, ""),
    "cogging": ("amplitude_nm", JOINT_NAMES[2], 0.005, "N m"),
    "backlash": ("gap_rad", JOINT_NAMES[3], 0.003, "rad"),
    "encoder_offset": ("offset_rad", JOINT_NAMES[4], 0.01, "rad"),
    "velocity_filter": ("time_constant_s", JOINT_NAMES[5], 0.003, "s"),
}


@pytest.mark.parametrize(
    ("verdict", "is_so"),
    [
        (of_effects("coulomb_friction", "load_friction", "cogging", "backlash"), True),
        (of_effects("coulomb_friction", "load_friction", "cogging", "backlash", half=0.1), False),
        (of_effects("coulomb_friction", "load_friction", "encoder_offset", "velocity_filter"), False),
    ],
    ids=["four of mechanics", "none of them clear", "two, and sensors"],
)
def test_a_robot_differs_everywhere_if_more_of_its_mechanics_is_clear_than_one_or_two_faults_have(verdict, is_so):
    known = knowing(KnownTriFinger(healthy_sessions()), verdict)
    assert isinstance(known, KnownTriFinger) and known.differs_everywhere is is_so
