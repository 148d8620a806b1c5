"""A study of data that an extended model was made from finds nothing more: the way that the documentation tells ends."""

import shutil

import pytest

from sim_backend.reality_gap.advice.answer import read_study
from sim_backend.reality_gap.study import run_study
from sim_backend.reality_gap.verdict import VerdictKind
from tests.unit.sim_backend.reality_gap.synthetic_arm import MODEL, STUDY, motion, write_csv

FRICTION_NM = (0.2, 0.1)


@pytest.mark.scale
def test_a_study_with_its_own_extended_model_finds_nothing_wrong(tmp_path):
    """`test_with_its_extended_model_nothing_more_is_found` has one cause at one joint, this one two at two."""
    for seed in (0, 1):
        write_csv(tmp_path / f"r{seed}.csv", *motion(seed, 5.0, friction_nm=FRICTION_NM))
    (tmp_path / "study.toml").write_text(STUDY)
    shutil.copy(MODEL, tmp_path / "model.xml")
    first = run_study(tmp_path / "study.toml", tmp_path / "first").verdict
    assert first.verdict is VerdictKind.NAMED
    told = read_study(tmp_path / "first").model
    assert told is not None and told.is_file(), "for whoever records the next motion of this arm"
    assert {(c.effect, c.where): c.value for c in first.causes} == {
        ("coulomb_friction", "joint1"): pytest.approx(0.2, rel=0.05),
        ("coulomb_friction", "joint2"): pytest.approx(0.1, rel=0.05),
    }
    shutil.copy(tmp_path / "first" / "extended-model.xml", tmp_path / "model.xml")
    second = run_study(tmp_path / "study.toml", tmp_path / "second").verdict
    assert second.verdict is VerdictKind.NOTHING_WRONG
    assert first.held_out is not None and second.held_out is not None
    assert second.held_out.before < 0.05 * first.held_out.before
