"""Steps of a fit end at their bounds, and what else there is makes up for it."""

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.unnamed_laws import GIVE
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.rollouts.bounded_steps import ends_of, moved_by, room_of, step_within

PRECISION, PULL = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]]), np.array([-3.0, 1.0, 0.5])
FREE = np.full(3, np.inf)


def test_a_step_without_bounds_is_that_of_gauss_and_newton():
    assert step_within(PRECISION, PULL, -FREE, FREE) == pytest.approx(np.linalg.solve(PRECISION, PULL))


def test_a_step_stops_at_a_bound_and_the_others_are_fitted_anew():
    below = step_within(PRECISION, PULL, np.array([-0.5, -np.inf, -np.inf]), FREE)
    assert below == pytest.approx([-0.5, (1.0 + 0.5) / 2.0, 0.5])
    above = step_within(PRECISION, PULL, -FREE, np.array([np.inf, 0.25, np.inf]))
    assert above == pytest.approx([-(3.0 + 0.25) / 2.0, 0.25, 0.5])


def test_what_is_kept_does_not_change():
    assert step_within(PRECISION, PULL, -FREE, FREE, np.array([True, False, False])) == pytest.approx([0.0, 0.5, 0.5])
    assert step_within(PRECISION, PULL, -FREE, FREE, np.full(3, True)) == pytest.approx(np.zeros(3))


def test_no_step_within_bounds_brings_more():
    """Two of 20 numbers that nearly do the same: a step that is cut off at its bounds is far from the best one."""
    rng = np.random.default_rng(5)
    image = rng.standard_normal((40, 20))
    image[:, 1] = image[:, 0] + 0.05 * image[:, 1]
    precision, pull = image.T @ image, image.T @ image @ (3.0 * rng.standard_normal(20))
    least, most = np.full(20, -1.0), np.full(20, 1.0)

    def brings(step: np.ndarray) -> float:
        return float(pull @ step - 0.5 * step @ precision @ step)

    best, cut_off = step_within(precision, pull, least, most), np.clip(np.linalg.solve(precision, pull), least, most)
    assert (best >= least).all() and (best <= most).all()
    slope = pull - precision @ best
    inside = (best > least) & (best < most)
    assert slope[inside] == pytest.approx(0.0, abs=1e-8 * np.abs(pull).max())
    assert (slope[best == most] > 0.0).all() and (slope[best == least] < 0.0).all()
    assert brings(best) > 1.1 * brings(cut_off)


def test_numbers_that_do_the_same_and_numbers_without_room_have_a_step_too():
    image = np.random.default_rng(1).standard_normal((30, 3))[:, [0, 1, 1, 2]]
    precision, least, most = 1e16 * image.T @ image + np.eye(4), np.array([-1.0, -1.0, -1.0, 0.0]), np.array([1.0, 1.0, 1.0, 0.0])
    step = step_within(precision, precision @ np.array([3.0, 0.2, 0.2, 1.0]), least, most)
    assert step[0] == 1.0 and step[3] == 0.0 and np.isfinite(step).all()


def test_what_stands_outside_its_tolerance_comes_back():
    mass = (Term("link_mass.factor", 0, 1e-2),)
    start = JointState(1)
    room = room_of(start.moved(mass[0], 0.05), start, mass, np.array([0.01]), causes=0)
    assert np.concatenate(room) == pytest.approx([-0.07, -0.03])
    assert step_within(np.eye(1), np.zeros(1), *room) == pytest.approx([-0.03])


def test_causes_go_as_far_as_the_catalogue_and_tolerances_as_far_as_they_are_tolerated():
    terms = (
        Term("viscous_friction.damping_nm_s_rad", 0, 1e-3),
        Term("link_mass.factor", 1, 1e-2),
        Term(GIVE, 0, 1e-4),
    )
    start = JointState(2)
    state = start.moved(terms[1], 0.015).moved(terms[2], 2e-4)
    least, most = room_of(state, start, terms, np.array([1.0, 0.01, 5e-4]), causes=1)
    lower, upper = start.bounds(terms[0].key)
    assert (least[0], most[0]) == pytest.approx((lower, upper))
    assert (least[1], most[1]) == pytest.approx((-0.02 - 0.015, 0.02 - 0.015))
    assert (least[2], most[2]) == pytest.approx((-2e-4, 1e-3 - 2e-4))


def test_numbers_changed_together_are_those_changed_one_after_the_other():
    terms = [Term(key, index, 1e-3) for key in ("coulomb_friction.torque_nm", GIVE) for index in (0, 2)]
    state, change = JointState(3, {GIVE: np.array([0.1, 0.2, 0.3])}), np.array([0.02, 1e3, -0.05, -9.0])
    one_by_one = state
    for term, by in zip(terms, change, strict=True):
        here = one_by_one.value(term.key)[term.index]
        one_by_one = one_by_one.moved(term, np.clip(here + by, *ends_of(one_by_one, term)) - here)
    together = moved_by(state, terms, change)
    assert together.given.keys() == one_by_one.given.keys()
    for key, values in one_by_one.given.items():
        np.testing.assert_array_equal(together.value(key), values)
    np.testing.assert_array_equal(state.value(GIVE), [0.1, 0.2, 0.3])
