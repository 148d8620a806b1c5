"""What a clone has and an installed package has not, and the policies that both have."""

import pytest

from api_schemas.job import POLICY_TASKS, TaskName
from client_cli import installation
from client_cli.child_process import child_environment
from client_cli.errors import UsageProblem


@pytest.fixture
def installed(monkeypatch, tmp_path):
    """As in an environment's site-packages."""
    monkeypatch.setattr(installation, "ROOT", tmp_path)


def test_children_find_the_packages_of_a_clone():
    assert installation.clone() is not None
    assert str(installation.clone()) in child_environment()["PYTHONPATH"].split(":")


@pytest.mark.parametrize("command", [["chaos", "--quick"], ["experiment", "memory"], ["experiment", "--list"]], ids=" ".join)
def test_what_the_wheel_leaves_out_says_so(trifarm, installed, command):
    ended = trifarm(*command, "--json")
    assert ended.code == 2
    assert ended.document["error"]["exit_code"] == 2
    assert f"'{command[0]}' is part of trifarm's repository and not of the installed package: clone" in ended.err


@pytest.mark.parametrize("task", installation.SHIPPED)
def test_the_reference_policies_are_shipped_with_their_manifests(task):
    weights = installation.shipped_weights(task)
    assert weights.is_file()
    assert weights.with_suffix(".json").is_file()


@pytest.mark.parametrize("task", sorted(set(POLICY_TASKS) - set(installation.SHIPPED)))
def test_a_task_without_one_needs_a_policy(trifarm, task):
    with pytest.raises(UsageProblem, match=f"no policy for {task} is shipped, only for push and lift: name one with --policy"):
        installation.shipped_weights(TaskName(task))
    ended = trifarm("demo", "--task", task)
    assert ended.code == 2
    assert "starting" not in ended.err
