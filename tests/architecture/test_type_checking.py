"""What the type checker is told: nothing that makes it look away from a whole file, and of MuJoCo what the wheel says."""

import importlib.util
import re

from tests.architecture.test_documents import ROOT

_OF_A_FILE = re.compile(r"^\s*#\s*(?:pyrefly:\s*(?!ignore\[)|pyright:|type:\s*ignore)", re.MULTILINE)


def test_no_file_switches_a_rule_off_for_all_of_it():
    folders = [folder for folder in ROOT.iterdir() if folder.is_dir() and not folder.name.startswith(".")]
    files = [file for folder in folders for suffix in ("py", "pyi") for file in folder.rglob(f"*.{suffix}")]
    assert len(files) > 500
    found = [str(file.relative_to(ROOT)) for file in files if _OF_A_FILE.search(file.read_text())]
    assert not found, "say `# pyrefly: ignore[kind]` on the line that needs it, and why"


def test_the_stub_of_mujoco_says_what_its_wheel_says():
    spec = importlib.util.spec_from_file_location("make", ROOT / "typings/make.py")
    assert spec is not None and spec.loader is not None
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    everything = set(make.stub(lambda name: not name.startswith("_")).splitlines())
    said = [line for line in make.STUB.read_text().splitlines() if line.strip() != "..."]
    assert [line for line in said if line not in everything] == [], "run typings/make.py"
