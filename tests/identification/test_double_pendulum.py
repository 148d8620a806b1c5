"""A real double pendulum: Coulomb friction on both joints, and as good as the published parameters on runs that were left out."""

from pathlib import Path

import numpy as np
import pytest

from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.study import material_of
from sim_backend.reality_gap.subjects.joints.gain import errors_of, held_out_errors
from sim_backend.reality_gap.subjects.joints.identification import study_joints
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_torques import judge
from sim_backend.reality_gap.verdict import VerdictKind, names_of

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data"
PUBLISHED = {  # identified_parameters/design_C.1_model_1.0.yml: cf atan(100 v) and b v
    "coulomb_friction.torque_nm": np.array([0.16, 0.12]) * np.pi / 2,
    "viscous_friction.damping_nm_s_rad": np.array([0.001, 0.001]),
}


@pytest.mark.skipif(not DATA.is_dir(), reason="the measured data are not beside this checkout")
def test_coulomb_friction_is_named_on_both_joints_and_predicts_runs_that_were_left_out():
    material = material_of(ROOT / "docs/studies/double-pendulum/study.toml", DATA, lambda *_: None)
    assert material.study_file is not None
    assert len(material.recordings) == 10
    study = study_joints(material.study_file.compile_model(), material.recordings, lambda *_: None, robot=UnknownRobot())
    verdict = judge(study).verdict
    assert verdict.verdict is VerdictKind.NAMED
    assert names_of(verdict.causes) == {("coulomb_friction", "joint1"), ("coulomb_friction", "joint2")}

    start = errors_of(study.problem, study.start).by_joint_nm
    ours = held_out_errors(study.problem, study.fit.final).by_joint_nm  # leave one run out
    published = errors_of(study.problem, JointState(2, {**study.start.given, **PUBLISHED})).by_joint_nm
    assert (ours <= 1.02 * published).all(), (ours, published)
    assert (ours <= 0.8 * start).all(), (ours, start)
