"""``trifarm experiment`` passes on what it is asked and ends as its child does."""

import sys

import pytest
from typer.testing import CliRunner

from client_cli import experiment
from client_cli.errors import ClientError
from client_cli.main import app


@pytest.fixture
def ran(monkeypatch):
    """The command with a child that ends with a code."""

    def call(code, *flags):
        asked = []

        def command(*arguments):
            asked.append(arguments)
            return [sys.executable, "-c", f"import sys; sys.exit({code})"]

        monkeypatch.setattr(experiment, "module_command", command)
        return CliRunner().invoke(app, ["experiment", *flags]), asked

    return call


def test_flags_are_passed_on_and_what_is_not_given_is_not(ran, tmp_path):
    result, asked = ran(0, "memory", "--quick", "--only", "lstm", "--seed", "2", "--budget-minutes", "30", "--out", str(tmp_path))
    assert result.exit_code == 0
    flags = ("--quick", "--only", "lstm", "--seed", "2", "--budget-minutes", "30.0", "--out", str(tmp_path))
    assert asked == [("experiments", "memory", *flags)]


@pytest.mark.parametrize("code", [0, 1, 2, 130])
def test_it_ends_as_its_child_does(ran, code):
    assert ran(code, "objects", "--list")[0].exit_code == code


def test_another_end_is_an_error(ran):
    result, _ = ran(7, "objects")
    assert isinstance(result.exception, ClientError) and "ended with code 7" in str(result.exception)
