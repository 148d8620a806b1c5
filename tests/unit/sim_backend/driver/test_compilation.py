"""Compiled code is kept between processes, and no process fails because it cannot be kept."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests import ROOT

INSTALL = "from sim_backend.driver import native_control; native_control.install(); print('installed')"
SMALL = """
import numba
from sim_backend.driver.compilation import compiled_once
tried = []
made = compiled_once(lambda cache: tried.append(cache) or numba.njit('f8(f8)', cache=cache)(lambda x: 2 * x))
print(made(21.0), *tried)
"""


def run(code: str, **environment: str) -> str:
    kept = {name: value for name, value in os.environ.items() if name not in {"XDG_CACHE_HOME", "HOME"}}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=kept | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("variable", ["HOME", "XDG_CACHE_HOME"])
def test_a_folder_that_cannot_be_written_is_no_obstacle(variable: str):
    assert run(SMALL, **{variable: "/proc/nowhere"}).split() == ["42.0", "False"]


@pytest.mark.scale
def test_a_robot_s_control_is_compiled_where_no_folder_can_be_written():
    """`test_a_folder_that_cannot_be_written_is_no_obstacle` compiles less."""
    assert "installed" in run(INSTALL, HOME="/proc/nowhere")


WARM = "from sim_backend.driver.compilation import is_kept; from sim_backend.warm_up import main; "


def python(code: str, cache: Path | None = None, cwd: Path | None = None) -> list[str]:
    """The words that a process prints; ``cache`` is its folder of compiled code where that is not the user's."""
    env = os.environ | ({} if cache is None else {"XDG_CACHE_HOME": str(cache)})
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=env, cwd=cwd, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_what_was_compiled_is_kept_and_after_warming_up_a_robot_compiles_nothing(tmp_path: Path):
    """In a copy of the user's folder, in which nobody else works; numba's own events tell what it compiles nevertheless.

    Nor does one of the same sources in another folder, which it asks where it is.
    """
    assert python(WARM + "main(); print(is_kept())") == ["True"]
    kept = Path(python("from sim_backend.driver.compilation import _folder; print(_folder())")[0])
    copied = shutil.copytree(kept, tmp_path / "trifarm" / kept.name)
    written = {path: path.stat().st_mtime_ns for path in copied.rglob("*.nb*")}
    asked = "from numba.core import event\nwith event.install_recorder('numba:compile') as compiled: main()\n"
    assert python(f"{WARM}\n{asked}print(len(compiled.buffer))", cache=tmp_path) == ["0"]
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    for package in ("sim_backend", "api_schemas", "trial_logs"):
        (elsewhere / package).symlink_to(ROOT / package)
    there = python(f"{WARM}\n{asked}print(len(compiled.buffer), main.__code__.co_filename)", tmp_path, elsewhere)
    assert there == ["0", str(elsewhere / "sim_backend/warm_up.py")]
    assert {path: path.stat().st_mtime_ns for path in copied.rglob("*.nb*")} == written and len(written) >= 8
    assert python(WARM + "print(is_kept())", cache=tmp_path / "empty") == ["False"]


@pytest.mark.scale
def test_an_empty_folder_is_filled_and_left_alone_from_then_on(tmp_path: Path):
    """`test_what_was_compiled_is_kept_and_after_warming_up_a_robot_compiles_nothing` asks it of the folder that is there."""
    assert python(WARM + "print(is_kept()); main(); print(is_kept())", cache=tmp_path) == ["False", "True"]
    written = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")}
    assert python(WARM + "print(is_kept()); main()", cache=tmp_path) == ["True"]
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")} == written and len(written) >= 4
