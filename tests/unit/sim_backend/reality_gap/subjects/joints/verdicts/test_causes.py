"""Numbers of effects as causes with intervals."""

from types import SimpleNamespace

import pytest

from sim_backend.reality_gap.subjects.joints.verdicts.causes import index_of, is_clear
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


def test_what_is_clear_at_one_joint_of_a_finger_need_not_be_at_another():
    """Values of such robots are off by as much at a lowest joint, which carries next to nothing."""
    study = SimpleNamespace(
        fit=SimpleNamespace(accepted=()),
        problem=SimpleNamespace(names=c.JOINT_NAMES),
        problem_start=lambda key, index: 0.0,
        is_of_many=True,
    )
    assert [is_clear(study, cause("load_friction.coefficient", 0.1, 0.3, joint)) for joint in range(3)] == [True, True, False]
