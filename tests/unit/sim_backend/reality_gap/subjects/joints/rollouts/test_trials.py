"""What is tried, and from where: by straight lines as far as these lead, and rivals until they have settled."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts import rollout_search, rollout_trials
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_search import GATE, tried_beside
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_trials import fitted_instead, fitted_wholly


def hypothesis(effect: str) -> SimpleNamespace:
    return SimpleNamespace(name=(effect, "hinge"), effect=effect, where="hinge", terms=[0], scales=[1.0])


@pytest.fixture
def begins(monkeypatch):
    """Tries a cause that gains ``linear`` nats by a straight line and ``gained`` when it is fitted; says where its fits began."""

    def of(linear: float, windows: int, gained: float = 1.0) -> list[float]:
        found = list[float]()

        def quickly(problem, fit, own, cause, terms, values, **_):
            found.append(float(values[0]))
            return gained, fit, cause, terms

        cause = hypothesis("viscous_friction")
        monkeypatch.setattr(rollout_search, "gains", lambda *_: [(linear, cause, np.array([5.0]), np.array([1.0]))])
        monkeypatch.setattr(rollout_search, "fitted_quickly", quickly)
        monkeypatch.setattr(rollout_search, "_is_possible", lambda *_, **__: False)
        catalogue = SimpleNamespace(hypotheses=[cause], terms=[SimpleNamespace(key="viscous_friction.damping_nm_s_rad")])
        search = SimpleNamespace(problem=SimpleNamespace(windows=range(windows)), catalogue=catalogue, proposed={})
        tried_beside(search, SimpleNamespace(state=None), ())
        return found

    return of


def test_of_few_windows_less_is_asked_before_a_cause_is_tried(begins):
    assert begins(linear=0.6, windows=5) == [5.0]
    assert begins(linear=0.6, windows=60) == begins(linear=0.4, windows=5) == []
    assert begins(linear=3.1, windows=60) == [5.0]


def test_a_straight_line_that_promised_much_and_gained_nothing_is_followed_less_far(begins):
    assert begins(linear=GATE, windows=40, gained=-9.0) == [5.0, 1.0]
    assert begins(linear=GATE, windows=40, gained=4.0) == begins(linear=0.9 * GATE, windows=40, gained=-9.0) == [5.0]


def test_a_rival_is_fitted_until_that_gains_no_more(monkeypatch):
    squares = iter([8.0, 2.0, 1.0, 0.99, 0.1])
    problem = SimpleNamespace(
        fitted=lambda state, terms, begin: SimpleNamespace(
            state=state, terms=terms, causes=len(terms), begin=begin, squares=next(squares)
        ),
        gained=lambda before, after: 10.0 * np.log(before / after),
    )
    monkeypatch.setattr(rollout_trials, "as_nominal", lambda _, state, terms: state)
    found = fitted_instead(problem, SimpleNamespace(state=None, begin=None), [], [], None, [])
    assert found.squares == 1.0


def test_a_cause_is_fitted_from_nominal_tolerances_too_which_had_made_up_for_it(monkeypatch):
    """With friction as far up as it may be a fit of cogging stayed where it was: no step brought windows nearer."""
    friction, start = Term("coulomb_friction.torque_nm", 0, 1e-3), JointState(1)
    stuck = start.moved(friction, 0.1)

    def fitted(state, terms, begin):
        is_anew = begin is None and state.value(friction.key)[0] == 0.0
        return SimpleNamespace(state=state, squares=1.0 if is_anew else 8.0)

    problem = SimpleNamespace(
        start=start,
        loose_terms=lambda _: [(friction, 0.05)],
        without_loose=lambda *_: start,
        fitted=fitted,
        gained=lambda before, after: 10.0 * np.log(before / after),
    )
    monkeypatch.setattr(rollout_trials, "foretold_rad", lambda *_: 0.0)
    gains = [
        fitted_wholly(problem, SimpleNamespace(squares=8.0), (), SimpleNamespace(state=state, begin=0), None, ())[0]
        for state in (stuck, start)
    ]
    assert gains == [pytest.approx(10.0 * np.log(8.0)), 0.0]
