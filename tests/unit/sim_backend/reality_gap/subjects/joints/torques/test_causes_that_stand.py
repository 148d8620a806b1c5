"""Which causes still stand in the values that a model gets."""

from types import SimpleNamespace

import pytest

from sim_backend.reality_gap.knowledge.healthy import NO_SESSIONS
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, UnknownRobot
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.torques.fit import _fallen
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted

KEY, START = "coulomb_friction.torque_nm", JointState(2)
TRIFINGER = KnownTriFinger(NO_SESSIONS)


def fit(chosen, left, robot=TRIFINGER, *, expects_many=False):
    terms = tuple(Term(KEY, joint, 0.01) for joint in range(len(chosen)))
    states = [START.with_values({(KEY, j): value for j, value in enumerate(values)}) for values in (chosen, left)]
    return SimpleNamespace(
        problem=SimpleNamespace(robot=robot, expects_many=expects_many, start=START),
        accepted=[Accepted("coulomb_friction", "elbow", terms, 20.0)],
        last=SimpleNamespace(state=states[0]),
        state=states[1],
    )


@pytest.mark.parametrize(
    ("chosen", "left", "stands"),
    [
        ([0.04], [0.03], True),
        ([0.04], [0.01], False),
        ([0.001, 0.04], [0.0001, 0.035], True),  # a group, one joint of which has next to nothing
        ([0.03, 0.04], [0.01, 0.01], False),
    ],
)
def test_a_cause_stands_if_half_of_its_value_is_left(chosen, left, stands):
    assert _fallen(fit(chosen, left)) == (frozenset() if stands else {("coulomb_friction", "elbow")})


def test_of_other_robots_and_of_many_causes_values_are_fitted_as_they_were_chosen():
    assert not _fallen(fit([0.04], [0.01], UnknownRobot()))
    assert not _fallen(fit([0.04], [0.01], expects_many=True))
