"""A TriFinger's cause that only stands beside what a healthy robot may be off is none: robots of the blind test with seed 2305.

The robots and what is hidden in them are those that the commit before was wrong about.
"""

import mujoco
import pytest

from sim_backend.reality_gap.bench.joint_cases import Case, recordings_of
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.subjects.joints.identification import JointStudy, study_joints
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.verdict import VerdictKind
from sim_backend.trifinger.scene import compile_scene

OFFSET = Case(84, 1807104781, "encoder_offset", "encoder_offset.offset_rad", "finger240_upper_to_middle", 7, 5.0, -0.0202)
NOISE = Case(223, 734180204, "joint_noise", "joint_noise.position_rad", "finger240_upper_to_middle", 7, 5.0, 0.00093)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return compile_scene()


def study_of(case: Case, model: mujoco.MjModel) -> JointStudy:
    (recordings,) = recordings_of([case])
    return study_joints(model, recordings, lambda *_: None, robot=KnownTriFinger.seen_in(recordings))


def test_a_cause_whose_value_collapses_gives_way_to_one_that_stands(model):
    """A weak motor of the joint above gained more as long as masses and torques of the whole finger could go along with it."""
    study = study_of(OFFSET, model)
    verdict = judge(study).verdict
    assert ("torque_constant", "finger240_base_to_upper") in study.fit.fallen
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    (cause,) = verdict.causes
    assert (cause.effect, cause.where) == ("encoder_offset", OFFSET.where)
    assert cause.interval_90[0] <= OFFSET.value <= cause.interval_90[1]


def test_noise_is_not_hidden_by_a_cause_that_is_too_little_to_be_one(model):
    verdict = judge(study_of(NOISE, model)).verdict
    assert verdict.verdict is VerdictKind.NAMED, verdict.summary
    (cause,) = verdict.causes
    assert (cause.effect, cause.parameter, cause.where) == ("joint_noise", "position_rad", NOISE.where)
