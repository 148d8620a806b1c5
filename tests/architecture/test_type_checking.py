"""What the type checker is told: nothing that makes it look away from a whole file, and of MuJoCo what the wheel says."""

import importlib.util
import re
import subprocess

from tests.architecture.test_documents import ROOT

_OF_A_FILE = re.compile(r"^\s*#\s*pyright:\s*(?!ignore\[)", re.MULTILINE)


def test_no_file_switches_a_rule_off_for_all_of_it():
    listed = subprocess.run(["git", "ls-files", "*.py", "*.pyi"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    found = [name for name in listed.split() if (ROOT / name).exists() and _OF_A_FILE.search((ROOT / name).read_text())]
    assert not found, "say `# pyright: ignore[rule]` on the line that needs it, and why"


def test_the_stub_of_mujoco_says_what_its_wheel_says():
    spec = importlib.util.spec_from_file_location("make", ROOT / "typings/make.py")
    assert spec is not None and spec.loader is not None
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    everything = set(make.stub(lambda name: not name.startswith("_")).splitlines())
    said = [line for line in make.STUB.read_text().splitlines() if line.strip() != "..."]
    assert [line for line in said if line not in everything] == [], "run typings/make.py"
