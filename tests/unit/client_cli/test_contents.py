"""The list of all commands is a table: it costs little, and says of each command what that says itself."""

import json
import resource
import subprocess
import sys

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from client_cli.main import COMMANDS, app

HEAVY = {"torch", "mujoco", "onnxruntime", "numpy", "pydantic", "httpx", "api_schemas.job", "sim_backend"}
LISTS = "import sys; from client_cli.main import run; run({arguments!r})"
LOOKS = "import atexit, json, sys; atexit.register(lambda: print(json.dumps(sorted(sys.modules)), file=sys.stderr)); "
RICH_HELP = "import typer.rich_utils"
TRIES = 5
HELP_TAKES_S = 0.3
HELP_OVER_ITS_LIBRARY = 1.6
"""Measured: 1.2."""


@pytest.mark.parametrize("row", COMMANDS, ids=lambda row: row.name)
def test_a_line_of_the_table_is_the_first_paragraph_of_the_commands_own_help(row):
    assert row.load().help.split("\n\n")[0].replace("\n", " ") == row.help


def test_the_list_shows_the_rows_in_their_order():
    said = CliRunner().invoke(app, ["--help"], terminal_width=200).output
    lines = [line.strip("│ ") for line in said.splitlines()]
    places = [lines.index(next(line for line in lines if line.startswith(f"{row.name} "))) for row in COMMANDS]
    assert places == sorted(places)
    assert list(get_command(app).commands) == [row.name for row in COMMANDS]


def test_the_list_loads_no_command_and_a_command_no_other():
    assert not HEAVY & _modules("--help")
    assert not {row.where.partition(":")[0] for row in COMMANDS} & _modules("--help")
    loaded = {row.name for row in COMMANDS if row.where.partition(":")[0] in _modules("effects", "--help")}
    assert loaded == {"effects"}


def test_a_wrong_command_is_answered_with_the_nearest():
    said = CliRunner().invoke(app, ["reprot"])
    assert said.exit_code == 2
    assert "No such command 'reprot'. Did you mean 'report'?" in said.output


def test_the_list_costs_hardly_more_than_the_library_that_draws_it():
    help_s = min(_cpu_s(LISTS.format(arguments=["--help"])) for _ in range(TRIES))
    library_s = min(_cpu_s(RICH_HELP) for _ in range(TRIES))
    assert help_s < HELP_TAKES_S
    assert help_s < HELP_OVER_ITS_LIBRARY * library_s


def _modules(*arguments):
    """Names of all modules that are loaded at the end of a command."""
    code = LOOKS + LISTS.format(arguments=list(arguments))
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(json.loads(ended.stderr.splitlines()[-1]))


def _cpu_s(code):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
