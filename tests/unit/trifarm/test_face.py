"""The face: what ``import trifarm`` costs and loads, and that every name has an example and stands on its page."""

import inspect
import resource
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import trifarm
from tests import ROOT

HEAVY = ("torch", "mujoco", "onnxruntime", "numpy", "pydantic", "httpx", "gymnasium")
WITHIN_S = 0.3
BEST_OF = 5
MOST_TIMES = 6.0
"""A Python process that does nothing, on a machine where that alone takes long."""
DATA_ONLY = {
    "ClientError",
    "Evaluation",
    "LogUnreadableError",
    "Packed",
    "RecordingError",
    "PolicyCheck",
    "Report",
    "StudyResult",
}
"""What is only ever received: the examples of what gives it show it."""


def _cpu_s(code):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def test_the_import_takes_less_than_0_3_s_of_cpu():
    nothing_s = min(_cpu_s("pass") for _ in range(BEST_OF))
    assert min(_cpu_s("import trifarm") for _ in range(BEST_OF)) < max(WITHIN_S, MOST_TIMES * nothing_s)


def test_the_import_loads_nothing_else():
    code = f"import sys, trifarm; sys.exit(' '.join(name for name in {HEAVY!r} if name in sys.modules) or 0)"
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", trifarm.__all__)
def test_every_name_is_there_documented_and_shown(name):
    text = inspect.getdoc(getattr(trifarm, name))
    assert text
    assert name in DATA_ONLY or ">>> " in text, f"trifarm.{name} has no example"


def test_what_is_not_there_is_said_with_what_is():
    with pytest.raises(AttributeError, match="'Fram'; it has ClientError, EvaluateOnFarm"):
        trifarm.Fram  # noqa: B018


def test_what_an_extra_brings_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    for name in [name for name in sys.modules if name.startswith("sim_backend.environments.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(vars(trifarm), "TrifingerEnv", raising=False)
    with pytest.raises(ImportError, match=r"trifarm\.TrifingerEnv needs gymnasium: pip install -e '\.\[learning\]' in the clone"):
        trifarm.TrifingerEnv  # noqa: B018


def test_the_page_is_that_of_the_docstrings():
    page = runpy.run_path(str(ROOT / "docs/python_page.py"))["page"]()
    assert (ROOT / "docs/python.md").read_text() == page, "python docs/python_page.py writes it anew"


@pytest.mark.parametrize(
    ("found", "written"),
    [
        (lambda self, one, *, two=2: None, "one, *, two=2"),
        (lambda one, **others: None, "one, **others"),
        (lambda *ones, two, **others: None, "*ones, two, **others"),
        (lambda cls, one, two="b": None, 'one, two="b"'),
    ],
)
def test_signatures_are_written_as_they_are_called(found, written):
    signature = runpy.run_path(str(ROOT / "docs/python_page.py"))["_signature"]
    assert signature("it", found) == [f"trifarm.it({written})"]


def test_a_file_that_is_no_report_is_a_sentence(tmp_path):
    with pytest.raises(trifarm.ClientError, match="cannot read"):
        trifarm.report(tmp_path / "absent.json")
    (tmp_path / "report.json").write_text("{}")
    with pytest.raises(trifarm.ClientError, match="is no report of a job"):
        trifarm.report(tmp_path)


def test_a_layout_that_does_not_exist_is_refused_with_those_that_do(tmp_path):
    weights = tmp_path / "p.safetensors"
    weights.write_bytes(b"weights")
    with pytest.raises(trifarm.ClientError, match="neither a manifest's file nor a layout; layouts are rrc2022-push"):
        trifarm.check(weights, expects="rrc2022-psuh")


def test_a_policy_that_the_farm_would_refuse_is_a_verdict(tmp_path):
    weights = Path(tmp_path / "p.safetensors")
    weights.write_bytes(b"weights")
    said = trifarm.check(weights, expects="rrc2022-push")
    assert not said.accepted
    assert said.problem is not None
