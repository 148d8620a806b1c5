"""``trifarm experiment`` passes on what it is asked and ends as its child does."""

import sys

import pytest
from typer.testing import CliRunner

from client_cli.commands import experiment
from client_cli.main import app
from client_cli.terminal.errors import ClientError, Interrupted, UsageProblem


@pytest.fixture
def ran(monkeypatch):
    """The command with a child that ends with a code."""

    def call(code, *flags):
        asked = []

        def command(*arguments):
            asked.append(arguments)
            return [sys.executable, "-c", f"import sys; sys.exit({code})"]

        monkeypatch.setattr(experiment, "clone_command", command)
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


def test_a_name_that_there_is_not_is_told_before_anything_is_needed(ran):
    result, asked = ran(0, "ablation-agian")
    assert isinstance(result.exception, UsageProblem) and not asked
    assert str(result.exception).endswith("did you mean ablation-again?")


def test_the_help_names_every_experiment_that_there_is():
    from experiments.catalogue import CATALOGUE

    assert list(experiment.NAMES) == list(CATALOGUE)
    said = " ".join(CliRunner().invoke(app, ["experiment", "--help"], terminal_width=200).output.split())
    assert all(name in said for name in CATALOGUE)


def test_without_a_name_all_are_listed_and_nothing_else_is_done(ran):
    result, asked = ran(0, "--list", "--json")
    assert result.exit_code == 0 and asked == [("experiments", "--list", "--json")]
    result, asked = ran(0, "--quick")
    assert isinstance(result.exception, UsageProblem) and "say which experiment: observations, " in str(result.exception)
    assert asked == []


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (["memory"], "'experiment' has been stopped; the same command goes on"),
        (["memory", "--quick"], "'experiment' has been stopped; with the --out that it named above, the same command goes on"),
        (["memory", "--quick", "--out", "there"], "'experiment' has been stopped; the same command goes on"),
    ],
)
def test_who_stops_it_is_told_how_to_go_on_and_it_gets_the_time_that_trainings_need(monkeypatch, flags, sentence):
    asked = {}

    def stopped(_command, interrupted, **how):
        asked.update(how)
        raise Interrupted(interrupted)

    monkeypatch.setattr(experiment, "run_to_end", stopped)
    result = CliRunner().invoke(app, ["experiment", *flags])
    assert str(result.exception) == sentence
    assert asked == {"ends_within_s": 40.0}
