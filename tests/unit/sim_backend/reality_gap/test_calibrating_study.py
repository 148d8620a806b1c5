"""A study by a method that calibrates: numbers, and no cause."""

import json
import shutil

import pytest

from sim_backend.reality_gap.advice.advice import advice_after
from sim_backend.reality_gap.recording import RecordingError
from sim_backend.reality_gap.report.sentences import cause_sentences, headline
from sim_backend.reality_gap.study import run_study
from sim_backend.reality_gap.verdict import VerdictKind
from tests.unit.sim_backend.reality_gap.synthetic_arm import MODEL, STUDY, motion, write_csv


@pytest.fixture
def study_file(tmp_path):
    """An arm whose supply was recorded, too."""
    write_csv(tmp_path / "r.csv", *motion(0, 4.0, friction_nm=(0.2, 0.1)))
    rows = (tmp_path / "r.csv").read_text().splitlines()
    (tmp_path / "r.csv").write_text("\n".join([f"{rows[0]},vbat", *(f"{row},24.0" for row in rows[1:])]) + "\n")
    (tmp_path / "study.toml").write_text(f'{STUDY}[signals]\nsupply_v = "vbat"\n')
    shutil.copy(MODEL, tmp_path / "model.xml")
    return tmp_path / "study.toml"


@pytest.mark.parametrize("method", ["simopt", "coordinate-descent"])
def test_a_calibration_says_that_it_names_nothing_and_keeps_its_numbers(study_file, tmp_path, method):
    verdict = run_study(study_file, tmp_path / "out", method=method).verdict
    assert verdict.verdict is VerdictKind.CALIBRATED and verdict.causes
    document = json.loads((tmp_path / "out" / "study.json").read_text())
    assert "names no cause" in headline(document)
    assert all(sentence.startswith("Calibrated: ") for sentence in cause_sentences(document))
    assert (tmp_path / "out" / "extended-model.xml").is_file(), "its numbers reproduce the data, which may be what is wanted"
    assert "names no cause" in advice_after(document["verdict"]).why
    assert any("supply_v" in said and "no cause is judged" in said for said in verdict.cannot_tell)


def test_a_method_that_does_not_exist_is_refused_before_anything_is_read(study_file, tmp_path):
    with pytest.raises(RecordingError, match=r"unknown method 'nameing'.*did you mean 'naming'"):
        run_study(study_file, tmp_path / "out", method="nameing")
    assert not (tmp_path / "out").exists()
