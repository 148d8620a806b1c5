"""How soon ``trifarm`` answers: help costs no more than its own text, and names every command as the command names itself."""

import resource
import subprocess
import sys

import numpy as np
import pytest
import typer

from client_cli.main import app

COMMANDS = typer.main.get_command(app).entries
HEAVY = ("torch", "mujoco", "onnxruntime", "onnx", "numpy", "httpx", "pydantic", "matplotlib", "client_cli.connection")
WITHIN_S = 0.3
PAIRS = 9
MOST_TIMES = 1.75
"""The library that draws help, on a machine where that alone takes longer: 1.5 alone, and 2.2 if numpy were loaded."""


def _cpu_s(*arguments):
    """User and system time of a Python process, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def test_help_takes_less_than_0_3_s_of_cpu():
    asked = (("-c", "import typer.rich_utils"), ("-m", "client_cli", "--help"))  # what drawing any help takes here, and ours
    pairs_s = np.array([[_cpu_s(*each) for each in asked] for _ in range(PAIRS)])  # in turns: what else runs here changes
    times = np.median(pairs_s[:, 1] / pairs_s[:, 0])
    assert pairs_s[:, 1].min() < WITHIN_S or times < MOST_TIMES, (
        f"{pairs_s[:, 1].min():.2f} s, {times:.2f} times as much as drawing"
    )


def test_help_loads_nothing_that_a_command_needs():
    code = f"""
import sys
from client_cli.main import run
try:
    run(["--help"])
except SystemExit:
    pass
sys.exit(" ".join(name for name in {HEAVY!r} if name in sys.modules) or 0)
"""
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", COMMANDS)
def test_the_table_of_contents_says_of_a_command_what_it_says_of_itself(name):
    group = typer.main.get_command(app)
    command = group.get_command(typer.Context(group), name)
    assert command.name == name
    assert COMMANDS[name].summary()
    assert " ".join(command.help.split()).startswith(" ".join(COMMANDS[name].summary().split()))


def test_an_unknown_command_is_refused_with_the_nearest_name():
    done = subprocess.run([sys.executable, "-m", "client_cli", "sumbit"], check=False, capture_output=True, text=True)
    assert done.returncode == 2
    assert "Did you mean 'submit'?" in done.stderr
