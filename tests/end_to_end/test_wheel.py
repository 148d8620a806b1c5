"""The wheel of a clone holds all that a user needs and nothing of the clone, and runs a trial in an empty folder."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from tests import ROOT

PACKAGES = ("api_schemas", "client_cli", "jail", "report_views", "robot_farm", "services", "sim_backend", "trial_logs", "trifarm")
OF_THE_WHEEL = (*(f"{package}/" for package in PACKAGES), "pyproject", "README", "LICENSE")
SOURCES_OF_A_BUILD = "services/dashboard/browser/"
"""What the pages' libraries are bundled from; the bundles are in the wheel."""
ONLY_IN_A_CLONE = ("chaos", "experiments", "tests", "docs", "results")
NOT_NEEDED = (
    "torch",
    "nvidia",
    "triton",
    "trifarm",
    "__editable__",
    "playwright",
    "pyrefly",
    "cuda",
    "stable_baselines3",
)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Built from the files that git keeps, so that nothing of this folder gets in."""
    clone, out = tmp_path_factory.mktemp("clone"), tmp_path_factory.mktemp("wheel")
    files = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout.decode().split("\0")
    for name in filter(None, files):
        if (
            name.startswith((*(f"{package}/" for package in PACKAGES), "pyproject", "README", "LICENSE"))
            and (ROOT / name).is_file()
        ):
            (clone / name).parent.mkdir(parents=True, exist_ok=True)
            (clone / name).symlink_to(ROOT / name)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*command, "--wheel-dir", str(out), str(clone)], check=True)
    (found,) = out.glob("trifarm-*.whl")
    return found


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A Python that has the wheel and this one's libraries, as links to the files: a jail opens none of another place."""
    folder = tmp_path_factory.mktemp("venv")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    packages = next((folder / "lib").glob("python3*")) / "site-packages"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(packages)
    for path in Path(sysconfig.get_path("purelib")).iterdir():
        if path.is_dir() and not path.name.startswith(NOT_NEEDED):
            shutil.copytree(path, packages / path.name, copy_function=link, symlinks=True, dirs_exist_ok=True)
        elif path.suffix in {".py", ".so"} and not path.name.startswith(NOT_NEEDED):
            link(path, packages / path.name)
    return folder / "bin/python"


def link(source, target):
    """A hard link where both are on one disk, a copy otherwise."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def run(python, folder, *arguments):
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("TRIFARM_", "PYTHON"))}
    environment["TRIFARM_HOME"] = str(folder / "home")
    command = [str(python), "-P", "-m", "client_cli", *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=240)


def test_it_has_every_file_of_the_packages_and_no_other(wheel):
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    listed = subprocess.run(["git", "ls-files", *PACKAGES], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    kept = {name for name in listed if (ROOT / name).is_file() and not name.startswith(SOURCES_OF_A_BUILD)}
    assert names <= kept
    assert {name for name in kept - names if not name.endswith(".md")} == set()
    assert "trifarm/py.typed" in names
    assert not {Path(name).parts[0] for name in names} & set(ONLY_IN_A_CLONE)


def test_a_demo_runs_in_an_empty_folder(installed, tmp_path):
    ended = run(installed, tmp_path, "demo", "--trials", "1", "--robots", "1", "--json")
    assert ended.returncode == 0, ended.stderr
    assert json.loads(ended.stdout)["report"]["trials"] == 1
    assert len(list((tmp_path / "demo-farm").glob("logs-*/trial-*.mcap"))) >= 1


@pytest.mark.parametrize("command", [["chaos", "--quick"], ["experiment", "--list"]], ids=lambda it: it[0])
def test_what_only_a_clone_has_is_said(installed, tmp_path, command):
    ended = run(installed, tmp_path, *command)
    assert ended.returncode == 2
    assert "is part of trifarm's repository, not of the installed package: clone the repository" in ended.stderr
