"""Logs and truths of earlier versions give the same arrays, and simulated again the same numbers."""

import hashlib
from dataclasses import fields

import numpy as np
import pytest

from api_schemas.report import IdentificationReport, Report, read_report
from client_cli.commands.verify import check
from sim_backend.replays.replay import EXIT_OTHER_FORM
from sim_backend.replays.replay import main as replay
from sim_backend.trifinger.form import scene_form
from tests.kept.versions import FARMS, VERSIONS, told, unpacked
from trial_logs.reader import read_log, read_truth

FILES = [(version, physics, file) for version, physics in FARMS for file in told(version, "arrays")[physics]]
FORM_OF = {"v0_1_0": "0.1.0"}
LOGS = [(version, physics, file) for version, physics, file in FILES if not file.endswith(".truth.mcap")]


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """The folder of a version's farm."""
    return {each: unpacked(*each, tmp_path_factory.mktemp("-".join(each))) for each in FARMS}


@pytest.mark.parametrize(("version", "physics", "file"), FILES)
def test_a_file_gives_the_arrays_that_it_gave(kept, version, physics, file):
    read = read_truth if file.endswith(".truth.mcap") else read_log
    log = read(kept[version, physics] / "fetched" / file)
    arrays = {field.name: getattr(log, field.name) for field in fields(log)}
    for name, (shape, digest) in told(version, "arrays")[physics][file].items():
        assert isinstance(arrays[name], np.ndarray), name
        assert list(arrays[name].shape) == shape, name
        assert hashlib.sha256(arrays[name].tobytes()).hexdigest() == digest, name


@pytest.mark.parametrize(("version", "physics", "file"), LOGS)
def test_simulated_again_a_trial_is_of_its_own_form(kept, version, physics, file, capsys):
    """The form of the scene is another now: the numbers may differ, and are not called wrong."""
    log = kept[version, physics] / "fetched" / file
    truth = log.with_suffix(".truth.mcap")
    options = ["--truth", str(truth)] if truth.exists() else []
    code, said = replay([str(log), "--verify", *options]), capsys.readouterr().out
    assert code in (0, EXIT_OTHER_FORM)
    wanted = f"is of form {FORM_OF[version]} of the scene, and this version simulates form {scene_form()}"
    assert code == 0 or (wanted in said and "says nothing against the log" in said)


@pytest.mark.parametrize(("version", "physics"), FARMS)
def test_reports_are_read(kept, version, physics):
    paths = sorted((kept[version, physics] / "fetched").glob("*/report.json"))
    reports = [read_report(path.read_bytes()) for path in paths]
    assert [report.job_id for report in reports] == [path.parent.name for path in paths]
    jobs = told(version, "jobs")[physics]
    for report in reports:
        is_identification = report.job_id == jobs.get("identification")
        assert isinstance(report, IdentificationReport if is_identification else Report)
        logs = kept[version, physics] / "fetched" / report.job_id
        for row in report.per_trial:
            assert hashlib.sha256((logs / f"trial-{row.trial:03d}.mcap").read_bytes()).hexdigest() == row.log_sha256


@pytest.mark.parametrize("version", VERSIONS)
def test_a_signed_page_is_still_found_true(kept, version):
    folder, job_id = kept[version, "nominal"], told(version, "jobs")["nominal"]["push"]
    page = (folder / "report.html").read_text()
    found = check(page, frozenset(), folder / "fetched" / job_id)
    assert (found.changed, found.missing, found.signature.job_id) == ((), (), job_id)
    assert check(page, frozenset([found.signature.key])).verdict == "true"
