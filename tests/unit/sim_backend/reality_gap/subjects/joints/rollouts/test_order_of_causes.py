"""The order in which causes are found must not decide which they are: searches that begin with another one."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS, Catalogue, Hypothesis
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts import rollout_search, rollout_selection
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutFit
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import CauseSearch, Taken, tried_beside
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection, _is_better, select_by_rollouts
from tests.unit.sim_backend.reality_gap.subjects.joints.pendulum import problem_of

OFF_RAD = 1e-3


def fit_of(off_rad: float) -> RolloutFit:
    """A fit whose windows all end up as far off as this, at one joint."""
    begin = np.zeros((1, 1)), np.zeros((1, 1))
    return RolloutFit(JointState(1), (), 0, np.zeros(0), np.zeros(0), np.full((4, 1), off_rad**2), begin)


def taken_of(effect: str, numbers: int = 1) -> Taken:
    terms = tuple(Term(f"{effect}.{i}", 0, 1e-3) for i in range(numbers))
    return Taken(Hypothesis(effect, "hinge", (0,), (1.0,)), terms, 99.0, ())


MASS, WEAK, SPRING = taken_of("link_mass"), taken_of("torque_constant"), taken_of("joint_stiffness", 2)
NOMINAL = fit_of(OFF_RAD)


def problem_with(gained: float = 0.0) -> SimpleNamespace:
    """A problem in which one model gains so many nats over another whichever they are, and is never near noise."""
    return SimpleNamespace(
        start=JointState(1),
        fitted=lambda *_: NOMINAL,
        otherwise=lambda: None,
        noise_rad=np.full(1, 1e-5),
        gained=lambda *_: gained,
        is_near_noise=lambda _: False,
    )


def paths_of(monkeypatch, left: float, ends: list[tuple[Taken, ...]], *, is_healthy: bool = False) -> list[tuple]:
    """What each path of a search began with, could take and had fitted before, where paths end with these."""
    gone, problem = [], problem_with()
    every = (*(each.hypothesis for each in (MASS, WEAK, SPRING)), Hypothesis("link_mass", ALL_JOINTS, (0,), (1.0,)))
    catalogue = Catalogue((), np.zeros(0), every, {})
    monkeypatch.setattr(rollout_selection, "_with_other_gravity", lambda *_: None)

    def path(search, nominal, _begun, first):
        taken = ends[len(gone)]
        asked = [each.name for each in search.catalogue.hypotheses]
        gone.append(([each.hypothesis.effect for each in first], asked, len(search.tried)))
        search.tried[id(nominal)] = nominal, [(99.0, fit_of(4e-4), each.hypothesis, ()) for each in (MASS, WEAK)]
        return RolloutSelection(problem, nominal, fit_of(left * OFF_RAD), taken, fit_of(left * OFF_RAD))

    monkeypatch.setattr(rollout_selection, "_path", path)
    select_by_rollouts(problem, catalogue, lambda _: True, healthy_rad=1e-2, is_healthy=lambda _: is_healthy)  # pyrefly: ignore[bad-argument-type]
    return gone


@pytest.mark.parametrize(
    ("left", "is_healthy", "paths"),
    [(0.45, True, 1), (0.35, True, 2), (0.45, False, 2)],
    ids=["may be healthy", "three fifths are gone", "is off"],
)
def test_the_order_is_doubted_where_a_robot_is_off_or_most_of_its_error_is_gone(monkeypatch, left, is_healthy, paths):
    assert len(paths_of(monkeypatch, left, [(MASS,), (WEAK,)], is_healthy=is_healthy)) == paths


def test_a_search_that_comes_back_to_what_was_found_goes_on_without_it(monkeypatch):
    """Neither at the same place nor at all joints, and what was fitted beside the same model is fitted anew."""
    every = [("link_mass", "hinge"), ("torque_constant", "hinge"), ("joint_stiffness", "hinge"), ("link_mass", ALL_JOINTS)]
    gone = paths_of(monkeypatch, 0.45, [(MASS,), (WEAK, MASS), (WEAK, SPRING)])
    assert gone == [([], every, 0), (["torque_constant"], every, 1), (["torque_constant"], every[1:3], 0)]


@pytest.mark.parametrize(
    ("one", "gained", "left", "is_better"),
    [
        ((WEAK,), 5.0, 0.3, True),
        ((WEAK,), 1.0, 0.3, False),
        ((WEAK,), 1.0, 0.01, True),
        ((WEAK, SPRING), 50.0, 0.3, False),
        ((WEAK, SPRING), 50.0, 0.01, True),
        ((WEAK, SPRING), 5.0, 0.01, False),
    ],
    ids=[
        "as few and nearer",
        "hardly nearer",
        "as few, and nothing is left",
        "more numbers",
        "more, and nothing is left",
        "more for too little",
    ],
)
def test_other_causes_are_better_where_they_are_as_few_and_nearer_or_leave_nothing(one, gained, left, is_better):
    problem = problem_with(gained)
    ends = [(one, fit_of(left * OFF_RAD)), ((MASS,), fit_of(0.3 * OFF_RAD))]
    other, found = (RolloutSelection(problem, NOMINAL, fit, taken, fit) for taken, fit in ends)  # pyrefly: ignore[bad-argument-type]
    assert _is_better(problem, other, found) is is_better  # pyrefly: ignore[bad-argument-type]


def test_what_may_be_taken_is_compared_where_it_has_settled(monkeypatch):
    problem = problem_of(hidden='frictionloss="0.08"')
    nominal, settled = problem.fitted(problem.start, ()), []
    own = rollout_search.gone_on
    monkeypatch.setattr(rollout_search, "gone_on", lambda *of: settled.append(own(*of)) or settled[-1])
    search = CauseSearch(problem, problem.catalogue, lambda _: True, lambda *_: None, {}, 0.0)
    tried = tried_beside(search, nominal, ())
    assert settled and tried[0][2].effect == "coulomb_friction"
    assert any(tried[0][1] is each[1] for each in settled)
