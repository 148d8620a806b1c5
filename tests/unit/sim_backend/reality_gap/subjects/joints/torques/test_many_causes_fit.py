"""Of a TriFinger with many causes values come from steady rows, and the play of its gears from all."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.healthy import NO_SESSIONS
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, UnknownRobot
from sim_backend.reality_gap.subjects.joints.laws.motor_law import GAP
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.torques import fit as fits
from sim_backend.reality_gap.subjects.joints.torques.fit import JointFit, _with_play_of_all_rows, select
from sim_backend.reality_gap.subjects.joints.torques.look import Accepted

FRICTION, START = "coulomb_friction.torque_nm", JointState(2)
TRIFINGER = KnownTriFinger(NO_SESSIONS)


@dataclass(frozen=True)
class Problem:
    """As much of a study's problem as a selection asks that finds no cause; ``noise`` relative to that of the sensors."""

    episodes: tuple
    robot: object
    noise: float
    expects_many: bool = False
    start: JointState = START

    @property
    def is_of_many(self):
        return self.expects_many and isinstance(self.robot, KnownTriFinger)

    def look(self, state, _):
        """One that finds nothing."""
        looked = SimpleNamespace(noise_ratio=np.full(2, self.noise), best_without=lambda *_: None, state=state)
        looked.trusting = lambda: looked
        looked.accepted_values = np.zeros(0)
        return looked


@pytest.mark.parametrize(
    ("robot", "noise", "are_steady"), [(TRIFINGER, 20.0, True), (TRIFINGER, 1.5, False), (UnknownRobot(), 20.0, False)]
)
def test_only_of_a_trifinger_with_many_causes_are_steady_rows_asked(robot, noise, are_steady, monkeypatch):
    monkeypatch.setattr(fits, "where_steady", lambda episodes: tuple(f"steady {each}" for each in episodes))
    found = select(Problem(("a", "b"), robot, noise), 3.0, lambda *_: None)
    assert found.problem.episodes == (("steady a", "steady b") if are_steady else ("a", "b"))


def test_the_width_of_a_play_is_that_of_all_rows_and_nothing_else_is_moved():
    friction = Accepted("coulomb_friction", "all joints", (Term(FRICTION, 0, 0.01), Term(FRICTION, 1, 0.01)), 90.0)
    play = Accepted("backlash", "knee", (Term(GAP, 1, 0.001),), 50.0)
    state = START.with_values({(FRICTION, 0): 0.05, (FRICTION, 1): 0.04, (GAP, 1): 0.02})
    errors = {("coulomb_friction", "all joints"): np.full(2, 1e-3), ("backlash", "knee"): np.full(1, 5e-3)}
    asked = []

    class Whole:
        def look(self, looked_at, accepted):
            asked.append((float(looked_at.value(GAP)[1]), tuple(a.effect for a in accepted)))
            hypothesis = SimpleNamespace(name=("backlash", "knee"), terms=(0,))
            candidate = SimpleNamespace(hypothesis=hypothesis, values=np.array([0.0025]))
            near = np.array([0.5 * (0.002 - looked_at.value(GAP)[1])])  # half of the way to what all rows show
            return SimpleNamespace(
                candidates=(candidate,),
                catalogue=SimpleNamespace(terms=(Term(GAP, 1, 0.001),)),
                accepted_values=near,
                accepted_errors=np.full(1, 1e-4),
            )

    fit = JointFit(SimpleNamespace(start=START), state, (friction, play), (), SimpleNamespace(), errors)
    found = _with_play_of_all_rows(fit, Whole())
    assert asked[0] == (0.0, ("coulomb_friction",))
    assert [effects for _, effects in asked[1:]] == [("backlash",)] * 2
    assert found.state.value(GAP)[1] == pytest.approx(0.002125)
    assert found.state.value(FRICTION).tolist() == [0.05, 0.04]
    assert found.errors["backlash", "knee"].tolist() == [1e-4]
    assert found.errors["coulomb_friction", "all joints"].tolist() == [1e-3, 1e-3]


def test_without_play_nothing_is_asked_again():
    fit = JointFit(SimpleNamespace(start=START), START, (), (), SimpleNamespace())
    assert _with_play_of_all_rows(fit, None) is fit
