"""The wheel: it holds the packages whole and nothing else, and works in an empty folder without the clone.

It is installed into a folder of its own, which stands before everything else on the path of the interpreter that runs the
tests: the dependencies are that one's, and the farm's jails know where they lie.
"""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LEFT_OUT = {"chaos", "experiments", "tests"}
PACKAGES = sorted(init.parent.name for init in ROOT.glob("*/__init__.py"))
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")
NOT_OF_THE_SOURCE = shutil.ignore_patterns("__pycache__")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """What a fresh clone has of it, without what an earlier build left behind."""
    folder = tmp_path_factory.mktemp("source")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=NOT_OF_THE_SOURCE)
    return folder


@pytest.fixture(scope="module")
def wheel(source, tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [*PIP, "wheel", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(folder), str(source)], check=True
    )
    (built,) = folder.glob("trifarm-*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    folder = tmp_path_factory.mktemp("installed")
    subprocess.run([*PIP, "install", "--no-deps", "--no-index", "--target", str(folder), str(wheel)], check=True)
    return folder


@pytest.fixture
def run(installed, tmp_path):
    """Runs a program in an empty folder."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("TRIFARM_", "PYTHON"))}
    environment = kept | {"PYTHONPATH": str(installed), "TRIFARM_HOME": str(tmp_path / "home")}
    (tmp_path / "empty").mkdir()

    def call(*command, check=True):
        ended = subprocess.run(command, cwd=tmp_path / "empty", env=environment, capture_output=True, text=True, check=False)
        assert ended.returncode == 0 or not check, ended.stderr
        return ended

    return call


@pytest.fixture
def trifarm(run, installed):
    return lambda *arguments, check=True: run(str(installed / "bin" / "trifarm"), *arguments, check=check)


def test_the_wheel_holds_every_file_of_its_packages_and_no_other(source, wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    files = {str(path.relative_to(source)) for package in PACKAGES for path in (source / package).rglob("*") if path.is_file()}
    assert set(PACKAGES) > LEFT_OUT
    assert names == {name for name in files if name.partition("/")[0] not in LEFT_OUT}


def test_nothing_is_taken_from_the_clone(run, installed):
    packages = [package for package in PACKAGES if package not in LEFT_OUT]
    code = f"import importlib, json; print(json.dumps([importlib.import_module(name).__file__ for name in {packages}]))"
    found = json.loads(run(sys.executable, "-P", "-c", code).stdout)
    assert found == [str(installed / package / "__init__.py") for package in packages]


def test_a_demo_of_the_shipped_policy(trifarm, tmp_path):
    ended = trifarm("demo", "--trials", "2", "--robots", "1", "--physics", "nominal", "--json")
    report = json.loads(ended.stdout)["report"]
    assert (report["trials"], report["platform_faults"]) == (2, 0)
    assert [path.name for path in (tmp_path / "empty").iterdir()] == ["demo-farm"]


@pytest.mark.parametrize("command", [["chaos"], ["experiment", "--list"]], ids=" ".join)
def test_commands_that_are_left_out_say_so(trifarm, command):
    ended = trifarm(*command, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith(f"error: '{command[0]}' is part of trifarm's repository and not of the installed package: ")
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize("command", [["--version"], ["effects"], ["train", "--help"]], ids=" ".join)
def test_other_commands_work(trifarm, command):
    assert trifarm(*command).stdout
