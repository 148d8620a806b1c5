"""What a named cause buys where it was not fitted."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.gain import TorqueErrors, errors_of, folds_of_rows, held_out, held_out_errors
from sim_backend.reality_gap.subjects.joints.identification import is_worth_it
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import ALL_JOINTS
from sim_backend.reality_gap.subjects.joints.laws.moves import deviations, moved
from sim_backend.reality_gap.subjects.joints.torques.fit import select
from sim_backend.reality_gap.subjects.joints.torques.normal_equations import FOLDS
from tests.unit.sim_backend.reality_gap.subjects.joints.driven_joints import NAMES, NO_LIMIT, planted_friction

PLANTED_NM = 0.03


@pytest.fixture(scope="module")
def planted():
    return planted_friction(PLANTED_NM)


@pytest.fixture(scope="module")
def fit(planted):
    return select(planted, 12.0, lambda *_: None, confirms=is_worth_it)


def test_the_cause_is_taken_alone(fit):
    assert [(a.effect, a.where) for a in fit.accepted] == [("coulomb_friction", NAMES[1])]
    assert fit.state.value("coulomb_friction.torque_nm")[1] == pytest.approx(PLANTED_NM, rel=0.05)


def test_of_all_joints_the_one_that_has_the_effect_already_is_not_asked_again(planted, fit):
    found = next(c for c in fit.last.candidates if c.hypothesis.name == ("coulomb_friction", ALL_JOINTS))
    assert (found.values[1], found.errors[1]) == (0.0, 0.0)
    assert np.all(found.errors[[0, 2]] > 0.0)
    assert found.gain < 0.0


def test_held_out_errors_fall_at_the_joint_that_has_it(planted, fit):
    before, after = errors_of(planted, NO_LIMIT), held_out_errors(planted, fit.last)
    assert before.by_joint_nm[1] == pytest.approx(PLANTED_NM, rel=0.15)
    assert after.by_joint_nm[1] < 0.3 * before.by_joint_nm[1]
    np.testing.assert_allclose(after.by_joint_nm[[0, 2]], before.by_joint_nm[[0, 2]], rtol=0.01)
    same = held_out_errors(planted, fit.first)
    np.testing.assert_array_equal(same.squares, before.squares)


def test_the_reduction_lies_in_its_interval_and_above_the_noise(planted, fit):
    found = held_out(planted, fit.last, NO_LIMIT, np.random.default_rng(2))
    low, high = found.reduction_interval_95
    assert low <= found.reduction <= high
    assert found.reduction == pytest.approx(1.0 - found.after / found.before)
    assert found.reduction > 0.7
    assert found.noise_floor < found.after < found.before
    assert found.samples == planted.episodes[0].valid_mechanics.sum()


def test_every_row_lies_in_one_fold(planted):
    fold = folds_of_rows(planted.episodes[0], 1)
    assert fold.shape == planted.episodes[0].path.time_s.shape
    assert set(fold) <= set(range(FOLDS))
    assert errors_of(planted, NO_LIMIT).rows.sum() == planted.episodes[0].valid_mechanics.sum()


def test_errors_are_root_mean_squares_over_rows():
    errors = TorqueErrors(np.array([[4.0, 0.0], [4.0, 1.0]]), np.array([[1.0, 0.0], [1.0, 4.0]]))
    assert errors.by_joint_nm == pytest.approx([2.0, 0.5])
    assert errors.all_joints_nm == pytest.approx(np.sqrt(9.0 / 6.0))


@pytest.mark.parametrize("effect", ("cogging", "joint_stiffness", "viscous_friction"))
def test_a_deviation_leads_from_the_start_to_the_state(planted, effect):
    hypothesis = next(c.hypothesis for c in planted.look(NO_LIMIT, ()).candidates if c.hypothesis.effect == effect)
    catalogue = planted.look(NO_LIMIT, ()).catalogue
    terms = tuple(catalogue.terms[i] for i in hypothesis.terms)
    values = np.linspace(0.01, 0.02, len(terms))
    np.testing.assert_allclose(deviations(moved(NO_LIMIT, terms, values), NO_LIMIT, terms), values)
