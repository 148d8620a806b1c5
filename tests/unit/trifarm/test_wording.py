"""A message of the command line names arguments to users of Python, and nothing else of it changes."""

import pytest

import trifarm
from client_cli.terminal.errors import UsageProblem
from trifarm.wording import of_python, worded


@pytest.mark.parametrize(
    ("detail", "said"),
    [
        ("--at-least goes with --until-known", "at_least goes with until_known"),
        ("at most --max N", "at most max_trials N"),
        ("'trifarm report j --json' shows it; --seed draws it", "'trifarm report j --json' shows it; seed draws it"),
        ("there is no file run--final.onnx", "there is no file run--final.onnx"),
    ],
)
def test_options_are_arguments_and_commands_stay(detail, said):
    assert of_python(detail, {"max": "max_trials"}) == said


def test_an_error_stays_the_one_that_it_was():
    with pytest.raises(UsageProblem, match=r"^give layout$") as raised, worded({}):
        raise UsageProblem("give --layout")
    assert raised.value.detail == "give layout"


def test_a_study_names_its_arguments(tmp_path):
    """The folder of the results is a file."""
    (tmp_path / "out").write_text("")
    (tmp_path / "study.toml").write_text("")
    with pytest.raises(trifarm.RecordingError, match=r"name another with out$"):
        trifarm.study(tmp_path / "study.toml", tmp_path / "out")
