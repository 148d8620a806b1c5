"""What a cause must gain beside others that are in the model already."""

from types import SimpleNamespace

import pytest

from sim_backend.reality_gap.knowledge.healthy import NO_SESSIONS
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, UnknownRobot
from sim_backend.reality_gap.subjects.joints.torques.fit import _later_gain
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted, Look

LEFT, ROWS = 6000.0, 10_000
"""What a model leaves of the mechanics of a session, nats, and their rows: noise takes 3,300 of it."""
SHARE = 0.01
TRIFINGER = KnownTriFinger(NO_SESSIONS)


def later_gain(*accepted, robot=TRIFINGER, expects_many=False, left=LEFT):
    look = Look(**(dict.fromkeys(Look.__dataclass_fields__) | {"mechanics_left": left, "mechanics_rows": ROWS}))
    problem = SimpleNamespace(robot=robot, expects_many=expects_many)
    return _later_gain(problem, look, [Accepted(effect, "all joints", (), gain) for effect, gain in accepted], SHARE)


def test_a_first_cause_need_gain_nothing_beside_others():
    assert later_gain()("backlash") == 0.0


def test_a_later_cause_gains_a_share_of_what_the_laws_leave_beyond_noise():
    least = later_gain(("coulomb_friction", 1e6))
    assert least("backlash") == pytest.approx(0.15 * (LEFT - 0.33 * ROWS))
    assert least("action_delay") == least("backlash"), "no command is in the model: nothing of theirs to mend"


def test_where_only_noise_is_left_the_share_of_everything_counts():
    assert later_gain(("coulomb_friction", 1e6), left=3000.0)("backlash") == pytest.approx(SHARE * 3000.0)


def test_beside_a_large_cause_of_the_commands_only_those_of_the_commands_must_gain_more():
    least = later_gain(("action_delay", 2e6), ("coulomb_friction", 9e6))
    assert least("timing_jitter") == pytest.approx(2000.0)
    assert least("velocity_filter") == pytest.approx(0.15 * (LEFT - 0.33 * ROWS))


@pytest.mark.parametrize(("robot", "expects_many", "share"), [(UnknownRobot(), False, 0.04), (TRIFINGER, True, 0.004)])
def test_where_it_is_not_known_what_noise_leaves_the_largest_cause_counts(robot, expects_many, share):
    least = later_gain(("coulomb_friction", 1e5), ("backlash", 1e4), robot=robot, expects_many=expects_many)
    assert {least("viscous_friction"), least("action_delay")} == {share * 1e5}
