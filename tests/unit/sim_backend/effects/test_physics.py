"""Physics: checked values, rows and stacks, and documents that give the same bits again."""

import json

import numpy as np
import pytest

from sim_backend.effects.physics import Physics
from tests.unit.sim_backend.effects.test_catalogue import everything


def test_nothing_given_is_nominal():
    assert Physics.nominal(3).is_nominal
    assert (Physics.nominal(3).value("cube_mass.factor") == 1.0).all()
    assert Physics.nominal(3).value("torque_constant.error").shape == (3, 9)


def test_one_number_stands_for_all_and_a_column_for_each_robot():
    assert (Physics.of(2, {"torque_constant.error": 0.1}).value("torque_constant.error") == 0.1).all()
    column = Physics.of(2, {"torque_constant.error": [0.1, 0.2]}).value("torque_constant.error")
    assert (column == [[0.1] * 9, [0.2] * 9]).all()


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"torque_konstant.error": 0.1}, "unknown effect 'torque_konstant'; choose from action_delay"),
        ({"torque_constant.eror": 0.1}, "no parameter 'torque_constant.eror'; choose from error"),
        ({"torque_constant.error": 0.9}, "torque_constant.error is 0.9; it must be between -0.5 and 0.5 (0 means absent)"),
        ({"torque_constant.error": np.nan}, "torque_constant.error is nan"),
        ({"torque_constant.error": np.zeros((2, 8))}, "must be a number or of shape (2, 9) (joint scope)"),
        ({"gravity.offset_m_s2": "up"}, "gravity.offset_m_s2 is 'up'"),
        ({"cube_mass.factor": "heavy"}, "cube_mass.factor is 'heavy'"),
    ],
)
def test_bad_values_are_named_with_what_would_be_valid(values, says):
    with pytest.raises(ValueError, match=says.replace("(", r"\(").replace(")", r"\)")):
        Physics.of(2, values)


def test_a_document_gives_the_same_bits_again():
    physics = everything(1).changed({"torque_constant.error": np.random.default_rng(1).uniform(-0.1, 0.1, (1, 9))})
    again = Physics.from_document(json.loads(json.dumps(physics.document())))
    assert again.given.keys() == physics.given.keys()
    assert all((again.given[key] == physics.given[key]).all() for key in physics.given)


def test_a_document_may_give_one_number_for_all_joints():
    physics = Physics.from_document({"coulomb_friction": {"torque_nm": 0.02}, "gravity": {"offset_m_s2": [0.0, 0.0, 0.1]}})
    assert (physics.value("coulomb_friction.torque_nm") == 0.02).all()
    assert (physics.value("gravity.offset_m_s2") == [[0.0, 0.0, 0.1]]).all()


def test_a_document_that_is_no_table_is_refused():
    with pytest.raises(ValueError, match="must be a table of torque_nm"):
        Physics.from_document({"coulomb_friction": 0.02})


def test_rows_stack_to_the_whole():
    physics = Physics.of(3, {"cube_mass.factor": [0.9, 1.0, 1.1]})
    rows = [physics.row(index) for index in range(3)]
    assert [row.is_nominal for row in rows] == [False, True, False]
    stacked = Physics.stack([*rows, Physics.of(1, {"action_delay.delay_s": 0.002})])
    assert stacked.value("cube_mass.factor").tolist() == [0.9, 1.0, 1.1, 1.0]
    assert stacked.value("action_delay.delay_s")[:, 0].tolist() == [0.0, 0.0, 0.0, 0.002]


def test_effects_can_be_left_out():
    physics = everything(2).without(["cube_mass", "backlash"])
    assert not physics.has("cube_mass") and not physics.has("backlash") and physics.has("cogging")
    with pytest.raises(ValueError, match="unknown effect 'gear'"):
        physics.without(["gear"])


def test_a_list_that_could_mean_robots_or_joints_is_refused():
    with pytest.raises(ValueError, match="one number for each robot, or one for each joint"):
        Physics.of(9, {"torque_constant.error": np.linspace(0, 0.1, 9)})
    assert Physics.of(9, {"torque_constant.error": np.linspace(0, 0.1, 9)[:, None]}).value("torque_constant.error")[3, 8] < 0.04


def test_some_robots_get_other_effects():
    three = Physics.of(3, {"cube_mass.factor": [1.0, 1.1, 1.2]})
    two = Physics.of(2, {"torque_constant.error": [0.1, 0.2], "cube_mass.factor": [0.9, 0.8]})
    merged = three.with_rows(np.array([2, 0]), two)
    assert merged.value("cube_mass.factor").tolist() == [0.8, 1.1, 0.9]
    assert merged.value("torque_constant.error")[:, 0].tolist() == [0.2, 0.0, 0.1]
    assert three.value("cube_mass.factor").tolist() == [1.0, 1.1, 1.2]
    assert merged.having("torque_constant").tolist() == [True, False, True]
    assert merged.rows(np.array([1])).given.keys() == merged.given.keys()
    assert merged.rows(np.array([2, 1])).value("cube_mass.factor").tolist() == [0.9, 1.1]
