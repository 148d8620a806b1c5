"""What lies near an end of a joint's range is not judged, and is said; a range that the robot leaves is to be checked."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.subjects.joints.identification import ShowsNothingError, study_joints
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.verdict import Verdict, VerdictKind
from tests.unit.sim_backend.reality_gap.subjects.joints.inverse_arm import arm, recorded

DEGREES = (-2.5, 2.5)
"""Meant as radians, in an MJCF whose compiler takes degrees."""


def verdict_with(**range_rad: tuple[float, float]) -> Verdict:
    model = arm()
    for name, ends in range_rad.items():
        model.joint(name).range, model.jnt_limited[model.joint(name).id] = ends, 1
    return judge(study_joints(model, [recorded(1), recorded(2)], lambda *_: None, robot=UnknownRobot())).verdict


def test_a_range_in_the_wrong_unit_is_to_be_checked():
    ends = tuple(np.radians(DEGREES))
    verdict = verdict_with(shoulder=ends, elbow=ends)
    assert verdict.verdict is VerdictKind.NOT_IDENTIFIABLE
    assert "away from the ends of its range" in verdict.summary
    (check,) = verdict.record_next
    assert check.startswith("nothing yet: check the range of shoulder and elbow in the MJCF")
    said = [each for each in verdict.cannot_tell if "the model has it from -0.0436 to 0.0436 rad, and it went from " in each]
    assert [each.split()[1] for each in said] == ["shoulder", "elbow"]


@pytest.mark.parametrize(("upper_rad", "is_told"), [(0.5, True), (3.0, False)])
def test_an_end_that_is_reached_now_and_then_is_told(upper_rad, is_told):
    verdict = verdict_with(elbow=(-3.0, upper_rad))
    assert verdict.verdict is VerdictKind.NOTHING_WRONG
    assert any("elbow does in" in each and "near an end of its range" in each for each in verdict.cannot_tell) == is_told
    assert not any("shoulder does in" in each for each in verdict.cannot_tell)


def test_of_times_in_milliseconds_that_are_read_as_seconds_it_is_said_how_far_rows_lie_apart():
    told = recorded(1)
    slow = replace(told, step_s=1e3 * told.step_s, time_s=1e3 * told.time_s)
    with pytest.raises(ShowsNothingError, match=r"rows 2 s apart \(is the unit of time right\?\)"):
        study_joints(arm(), [slow], lambda *_: None, robot=UnknownRobot())
