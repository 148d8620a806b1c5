"""What the data of joints cannot tell."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from sim_backend.reality_gap.subjects.joints.verdicts.untold import turned_bases
from sim_backend.reality_gap.verdict import Cause
from sim_backend.trifinger.constants import JOINT_NAMES


def offset(joint: int, value: float = 0.05) -> Cause:
    return Cause("encoder_offset", "offset_rad", JOINT_NAMES[joint], value, "rad", (value - 0.01, value + 0.01))


def study(*, is_of_many: bool = True):
    return SimpleNamespace(
        fit=SimpleNamespace(accepted=()),
        problem=SimpleNamespace(names=JOINT_NAMES),
        problem_start=lambda *_: 0.0,
        is_of_many=is_of_many,
    )


def test_encoders_of_first_joints_may_be_a_tilt_of_the_table_where_a_robot_differs_everywhere():
    causes = [offset(0), offset(1), offset(3), offset(6, 0.001)]
    assert [cause.where for cause in turned_bases(study(), causes)] == [JOINT_NAMES[0], JOINT_NAMES[3]], "of those that are sure"
    assert not turned_bases(study(is_of_many=False), causes), "elsewhere each of them was asked for itself"


@pytest.mark.parametrize("parameter", ["roll_rad", "pitch_rad"])
def test_a_tilt_that_is_told_is_not_told_again(parameter):
    tilt = Cause("table_tilt", parameter, "platform", 0.01, "rad", (0.005, 0.015))
    assert not turned_bases(study(), [offset(0), tilt])
    assert turned_bases(study(), [offset(0), replace(tilt, interval_90=(-0.005, 0.025))]), "it may be none"
