"""Which other hypothesis nearly did as well where a cause was taken."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.healthy import NO_SESSIONS
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS, Hypothesis
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted, Candidate, Look
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import Reduced
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import _rival, _tie_nats

NOTHING = np.zeros(0)
TRIFINGER = KnownTriFinger(NO_SESSIONS)


def candidate(effect, where, gain):
    return Candidate(Hypothesis(effect, where, (), ()), gain, 0.0, NOTHING, NOTHING, True, NOTHING)


def study(*looks):
    start = JointState(2)
    made = [SimpleNamespace(candidates=look, catalogue=SimpleNamespace(terms=()), state=start) for look in looks]
    fit = SimpleNamespace(looks=made, accepted=(), refused=frozenset(), fallen=frozenset())
    problem = SimpleNamespace(expects_many=False, names=("shoulder", "elbow"))
    return SimpleNamespace(fit=fit, problem=problem, robot=TRIFINGER, gates={}, gate=12.0, start=start)


@pytest.mark.parametrize(("where", "rival", "behind"), [(ALL_JOINTS, "viscous_friction", 1.0), ("elbow", "action_delay", 10.0)])
def test_all_joints_are_a_rival_of_all_joints_and_not_of_a_single_one(where, rival, behind):
    look = (
        candidate("coulomb_friction", where, 100.0),
        candidate("viscous_friction", ALL_JOINTS, 99.0),
        candidate("action_delay", "elbow", 90.0),
    )
    found = _rival(study(look), Accepted("coulomb_friction", where, (), 100.0))
    assert found is not None
    assert (found[0].effect, found[0].behind) == (rival, behind)


@pytest.mark.parametrize(("effect", "where"), [("directional_friction", "elbow"), ("coulomb_friction", "elbow")])
def test_friction_that_differs_by_direction_has_other_frictions_as_rivals_and_itself_next_door(effect, where):
    look = (candidate("directional_friction", "shoulder", 24.8), candidate(effect, where, 13.0))
    taken = Accepted("directional_friction", "shoulder", (), 24.8)
    found = _rival(study(look), taken)
    assert found is not None
    assert (found[0].effect, found[0].where) == (effect, where)
    assert found[0].behind < _tie_nats(taken, TRIFINGER)


@pytest.mark.parametrize(
    ("where", "gain", "taken"), [("elbow", 4.1, "coulomb"), ("elbow", 3.9, "directional"), ("wrist", 11.0, "directional")]
)
def test_another_friction_of_the_joint_is_taken_rather_than_one_that_differs_by_direction(where, gain, taken):
    look = Look(**dict.fromkeys(Look.__dataclass_fields__))
    found = (candidate("directional_friction", "elbow", 12.0), candidate("coulomb_friction", where, gain))
    best = replace(look, candidates=found, is_known=True).best
    assert best is not None
    assert best.hypothesis.effect == f"{taken}_friction"


def test_another_joint_with_the_same_effect_is_no_rival_else():
    look = (candidate("coulomb_friction", "shoulder", 24.8), candidate("coulomb_friction", "elbow", 24.0))
    taken = Accepted("coulomb_friction", "shoulder", (), 24.8)
    assert _rival(study(look), taken) is None
    assert _tie_nats(taken, TRIFINGER) == 5.0


def test_a_cause_is_compared_at_the_look_at_which_it_was_taken():
    """A group that takes the place of single joints leaves fewer causes than looks."""
    taken = candidate("action_delay", ALL_JOINTS, 50.0)
    looks = [
        (candidate("coulomb_friction", "elbow", 200.0), taken, candidate("viscous_friction", ALL_JOINTS, 80.0)),
        (candidate("coulomb_friction", ALL_JOINTS, 90.0),),
        (taken, candidate("viscous_friction", ALL_JOINTS, 20.0)),
    ]
    found = _rival(study(*looks), Accepted("action_delay", ALL_JOINTS, (), 50.0, look=2))
    assert found is not None
    assert found[0].behind == 30.0


@pytest.mark.parametrize(("alike", "is_rival"), [(0.9, True), (0.0, False)])
def test_what_explains_a_cause_away_is_its_rival_although_healthy_robots_have_as_much(alike, is_rival):
    """A cable that pulled at one joint was named a tilt of the table, where a spring at that joint gained four times as much."""
    images = 1e4 * np.array([[1.0, alike], [alike, 1.0]])
    rest = Reduced(images, images @ np.array([0.06, 0.0 if is_rival else 0.05]), 0.0)
    one = np.full(1, 0.01)
    load, tilt = (
        Candidate(Hypothesis(effect, where, (term,), (1.0,)), rest.gain((term,), (1.0,)), 0.0, one, one, True, one)
        for term, (effect, where) in enumerate([("load_friction", "elbow"), ("table_tilt", "platform")])
    )
    made = study((load, tilt))
    look = made.fit.looks[0]
    look.rest, look.catalogue.terms = rest, (Term("load_friction.coefficient", 0, 1.0), Term("table_tilt.roll_rad", 0, 1.0))
    made.gates = {"load_friction": 20.0, "table_tilt": 3.0}
    assert 3.0 < tilt.gain < load.gain < 20.0
    found = _rival(made, Accepted("table_tilt", "platform", (), tilt.gain))
    assert (found is not None) is is_rival
    if found is not None:
        assert (found[0].effect, found[0].behind) == ("load_friction", tilt.gain - load.gain)
