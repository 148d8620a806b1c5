"""Every example of the Python API runs, as written, beside a real farm; a log is read as arrays and as tables."""

import doctest
import gzip
import inspect
import itertools
import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trifarm
from tests import ROOT
from tests.end_to_end.farm import Farm
from trifarm.log import TableName

POLICY = ROOT / "sim_backend/training/reference_policies/push"
PENDULUM = ROOT / "docs/studies/double-pendulum"
DATA = ROOT.parent / "shared/data"
SAMPLES = 1000
"""Two seconds of the pendulum."""
FIRST = ("Farm", "FarmJob", "FarmTrial")
"""Their examples make the files that the others read."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A user's folder while a farm runs: the shipped policy, then the logs and the report of the first example."""
    folder = tmp_path_factory.mktemp("user")
    for suffix in (".safetensors", ".json"):
        shutil.copy(POLICY.with_suffix(suffix), folder)
    before, variables = Path.cwd(), dict(os.environ)
    real = Farm(tmp_path_factory.mktemp("farm"), robots=1)
    real.env["TRIFARM_SHARES"] = "true"
    with real as farm:
        os.environ["TRIFARM_HOME"] = farm.env["TRIFARM_HOME"]
        os.chdir(folder)
        try:
            for name in FIRST:
                run(name)
            with trifarm.Farm() as connection:
                (folder / "report.json").write_text(connection.jobs(limit=1)[0].report().model_dump_json())
            yield folder
        finally:
            os.chdir(before)
            os.environ.clear()
            os.environ.update(variables)


def run(name):
    """Runs the examples of a name and of its methods."""
    found = getattr(trifarm, name)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    for test in doctest.DocTestFinder(recurse=True).find(found, name, globs={}):
        runner.run(test)
    assert runner.summarize(verbose=False).failed == 0


def test_the_page_of_training_loops_runs_as_written(folder, capsys):
    pytest.importorskip("stable_baselines3")
    given = {}
    for code in re.findall(r"```python\n(.*?)```", (ROOT / "docs/training-loop.md").read_text(), re.DOTALL):
        exec(compile(code, "docs/training-loop.md", "exec"), given)
    assert "of 2 succeeded, 95 % interval" in capsys.readouterr().out
    assert given["callback"].found[0].step == 128 and all(each.report for each in given["callback"].found)


@pytest.mark.parametrize("name", [name for name in trifarm.__all__ if name not in (*FIRST, "study")])
def test_the_example_runs(folder, name):
    if ">>> import torch" in (inspect.getdoc(getattr(trifarm, name)) or ""):
        pytest.importorskip("torch")
    run(name)


def test_the_example_of_a_study_runs(folder):
    """With the first seconds of two recordings; `test_double_pendulum` has all ten as they are."""
    if not (DATA / "dfki_double_pendulum").is_dir():
        pytest.skip(f"{DATA}, the measured data beside the checkout, is not there")
    shutil.copytree(PENDULUM, folder / "pendulum")
    text = (folder / "pendulum/study.toml").read_text().replace("../../../../shared/data", "data")
    (folder / "pendulum/study.toml").write_text(text.replace("14*.csv.gz", "1433*.csv.gz").replace("15*.csv.gz", "1435*.csv.gz"))
    for recording in DATA.glob("dfki_double_pendulum/design_C.1*/143[35]*.csv.gz"):
        begin = folder / "pendulum/data" / recording.relative_to(DATA)
        begin.parent.mkdir(parents=True, exist_ok=True)
        with gzip.open(recording, "rt") as whole, gzip.open(begin, "wt", compresslevel=1) as some:
            some.writelines(itertools.islice(whole, 1 + SAMPLES))
    run("study")


def test_a_log_is_arrays_and_tables(folder):
    log = trifarm.read_log("trial-001.mcap")
    steps = len(log.joint_time_s)
    assert log.joint_position_rad.shape == log.applied_torque_nm.shape == (steps, 9)
    np.testing.assert_allclose(np.diff(log.joint_time_s), 1e-3)
    rows_of: dict[TableName, int] = {
        "joints": steps,
        "cube": len(log.cube_time_s),
        "tracker": len(log.capture_s),
        "policy": len(log.action),
    }
    for table, rows in rows_of.items():
        frame, arrow = log.to_pandas(table), log.to_arrow(table)
        assert len(frame) == arrow.num_rows == rows > 0
        assert list(frame.columns) == arrow.column_names
    torque = log.to_pandas()["applied_torque_nm.finger0_base_to_upper"]
    np.testing.assert_array_equal(torque, log.applied_torque_nm[:, 0])
    with pytest.raises(ValueError, match="choose from joints"):
        log.columns("motors")  # pyrefly: ignore[bad-argument-type] - it is refused


def test_the_notebook_runs(folder):
    cells = json.loads((ROOT / "docs/examples/trials.ipynb").read_text())["cells"]
    names: dict[str, Any] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "what a notebook printed once would age"
            exec("".join(cell["source"]), names)
    report, by_robot, seen = names["report"], names["by_robot"], names["seen"]
    assert by_robot.trials.sum() == report.trials
    assert len(seen) > 10 and seen.min() >= 0
