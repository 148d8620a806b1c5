"""Compiled code is kept between processes, and no process fails because it cannot be kept."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

INSTALL = "from sim_backend.driver import native_control; native_control.install(); print('installed')"


def run(**environment: str) -> str:
    kept = {name: value for name, value in os.environ.items() if name not in {"XDG_CACHE_HOME", "HOME"}}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", INSTALL],
        env=kept | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("variable", ["HOME", pytest.param("XDG_CACHE_HOME", marks=pytest.mark.scale)])
def test_a_folder_that_cannot_be_written_is_no_obstacle(variable: str):
    """`test_a_folder_that_cannot_be_written_is_no_obstacle` has one of the folder's names without scale."""
    assert "installed" in run(**{variable: "/proc/nowhere"})


def test_what_was_compiled_is_kept_and_after_warming_up_a_robot_compiles_nothing(tmp_path: Path):
    def python(code: str) -> str:
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=200,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    warm = "from sim_backend.driver.compilation import is_kept; from sim_backend.warm_up import main; "
    assert python(warm + "print(is_kept()); main(); print(is_kept())").split() == ["False", "True"]
    written = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")}
    assert python(warm + "print(is_kept()); main()").split() == ["True"]
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")} == written and len(written) >= 4
