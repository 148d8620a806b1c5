"""``trifarm compare``: what it prints, draws and exits with."""

from xml.etree import ElementTree

import pytest

from client_cli.terminal.exit_codes import ExitCode
from tests.unit.api_schemas.test_comparison import job


@pytest.fixture
def jobs(farm):
    good, bad = [True] * 9 + [False], [False] * 8 + [True, False]
    made = {"jgood": job("jgood", good), "jbad": job("jbad", bad), "jfar": job("jfar", good, first_seed=9)}
    lifted = job("jlift", good).model_copy(update={"task": "lift"})
    farm.reports = {name: each.model_dump_json().encode() for name, each in (made | {"jlift": lifted, "jlift2": lifted}).items()}
    farm.reports["jlift2"] = lifted.model_copy(update={"job_id": "jlift2"}).model_dump_json().encode()


@pytest.mark.usefixtures("jobs")
def test_a_worse_job_is_told_and_fails_where_that_was_asked_for(trifarm):
    ended = trifarm("compare", "jgood", "jbad", "--fail-if-worse")
    assert ended.code == ExitCode.WORSE
    assert "jbad against jgood: -80.0 points" in ended.out
    assert "McNemar's exact p 0.0078: worse" in ended.out
    assert ended.out.count("lost    trial") == 8
    assert trifarm("compare", "jgood", "jbad").code == ExitCode.OK
    assert trifarm("compare", "jbad", "jgood", "--fail-if-worse").code == ExitCode.OK


@pytest.mark.usefixtures("jobs")
def test_the_document_names_every_goal(trifarm):
    (task,) = trifarm("compare", "jgood", "jbad", "--json").document["tasks"]
    assert [goal["succeeded"] for goal in task["per_goal"]].count([True, False]) == 8
    assert task["differences"][0]["lost"] == 8


@pytest.mark.usefixtures("jobs")
def test_two_tasks_are_drawn_in_one_figure(trifarm, tmp_path):
    files = [tmp_path / "figure.svg", tmp_path / "figure.png"]
    ended = trifarm("compare", "jgood", "jbad", "jlift", "jlift2", *(f"--figure={file}" for file in files))
    assert ended.code == ExitCode.OK
    drawn = ElementTree.parse(files[0]).getroot().iter()
    assert sum(each.get("id", "").startswith("LineCollection") for each in drawn) == 6, "one interval for each job and difference"
    assert files[1].read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("jobs")
@pytest.mark.parametrize(
    "arguments, words",
    [
        (("jgood",), "only one"),
        (("jgood", "jfar"), "no goal in common"),
        (("jgood", "jbad", "--figure", "f.gif"), ".svg, .png, .pdf"),
    ],
)
def test_what_cannot_be_compared_is_wrong_usage(trifarm, arguments, words):
    ended = trifarm("compare", *arguments)
    assert (ended.code, words in ended.err) == (ExitCode.USAGE, True)
