"""Numbers of effects as causes with intervals."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.subjects.joints.verdicts.causes import extended_causes, index_of, is_clear
from sim_backend.reality_gap.verdict import Cause
from sim_backend.trifinger import constants as c

NAMES = ("lift", "x", "y", "z")
JOINT = "coulomb_friction.torque_nm"


@pytest.mark.parametrize(
    ("names", "key", "where", "index"),
    [
        (c.JOINT_NAMES, JOINT, c.JOINT_NAMES[4], 4),
        (NAMES, JOINT, "z", 3),
        (NAMES, "gravity.offset_m_s2", "z", 2),
        (c.JOINT_NAMES, "table_tilt.roll_rad", "platform", 0),
    ],
)
def test_which_number_a_place_means(names, key, where, index):
    assert index_of(names, key, where) == index


def cause(key, low, high, joint=0):
    effect, _, parameter = key.partition(".")
    return Cause(effect, parameter, c.JOINT_NAMES[joint], (low + high) / 2, "", (low, high))


@pytest.mark.parametrize(
    ("key", "low", "high", "is_it"),
    [
        (JOINT, 0.01, 0.03, True),
        (JOINT, -0.01, 0.03, False),
        ("load_friction.coefficient", 0.1, 0.3, True),
        ("stribeck_friction.speed_rad_s", 1.0, 2.0, False),  # no effect by itself
        ("joint_noise.position_rad", -1.0, 1.0, True),  # found without a fit
    ],
)
def test_what_is_clear_where_a_robot_differs_everywhere(key, low, high, is_it):
    study = SimpleNamespace(
        fit=SimpleNamespace(accepted=()),
        problem=SimpleNamespace(names=c.JOINT_NAMES),
        problem_start=lambda key, index: 0.0,
        is_of_many=True,
    )
    assert is_clear(study, cause(key, low, high)) is is_it
    study.is_of_many = False
    assert is_clear(study, cause(key, low, high)), "elsewhere whatever is named is told"


def of_many(is_of_many: bool = True) -> SimpleNamespace:
    return SimpleNamespace(
        fit=SimpleNamespace(accepted=()),
        problem=SimpleNamespace(names=c.JOINT_NAMES),
        problem_start=lambda key, index: 0.0,
        is_of_many=is_of_many,
    )


def test_what_ran_to_its_bound_makes_up_for_something_else_and_is_not_clear():
    key = "load_friction.coefficient"
    most = PARAMETERS[key].upper
    at_bound, inside = cause(key, most - 0.1, most + 0.1), cause(key, most - 0.2, most - 0.1)
    assert at_bound.value == pytest.approx(most)
    assert [is_clear(of_many(), replace(each, value=min(each.value, most))) for each in (at_bound, inside)] == [False, True]


def test_the_extended_model_of_a_robot_that_differs_everywhere_has_the_likeliest_values():
    sure, unsure, seen = cause(JOINT, 0.029, 0.031), cause(JOINT, -0.2, 0.3, 3), cause("joint_noise.position_rad", 0.0, 2e-4)
    found = extended_causes(of_many(), [sure, unsure, seen])
    assert [each.value for each in found] == [pytest.approx(0.03, rel=0.01), pytest.approx(0.0048, abs=0.001), seen.value]
    assert [each.interval_90 for each in found] == [each.interval_90 for each in (sure, unsure, seen)]
    assert extended_causes(of_many(is_of_many=False), [sure, unsure]) == []


def test_what_is_clear_at_one_joint_of_a_finger_need_not_be_at_another():
    """Values of such robots are off by as much at a lowest joint, which carries next to nothing."""
    study = SimpleNamespace(
        fit=SimpleNamespace(accepted=()),
        problem=SimpleNamespace(names=c.JOINT_NAMES),
        problem_start=lambda key, index: 0.0,
        is_of_many=True,
    )
    assert [is_clear(study, cause("load_friction.coefficient", 0.1, 0.3, joint)) for joint in range(3)] == [True, True, False]
