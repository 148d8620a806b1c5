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
