"""What is said of a policy that is sent to another task than its layout's."""

import pytest

from api_schemas.job import POLICY_TASKS, TaskName
from api_schemas.policy import LAYOUTS
from client_cli.policies.trying import OWN_TASKS, of_another_task


@pytest.mark.parametrize("name", OWN_TASKS)
def test_only_the_other_of_both_tasks_is_worth_a_sentence(name):
    told = {task: of_another_task(LAYOUTS[name], task) for task in POLICY_TASKS}
    other = {TaskName.PUSH: TaskName.LIFT, TaskName.LIFT: TaskName.PUSH}[OWN_TASKS[name]]
    sentence = told.pop(other)
    assert sentence is not None and f"{name}, the layout of {OWN_TASKS[name].value}, and the job is {other.value}" in sentence
    assert set(told.values()) == {None}


@pytest.mark.parametrize("name", sorted(LAYOUTS.keys() - OWN_TASKS.keys()))
def test_a_layout_of_no_single_task_is_at_home_everywhere(name):
    assert {of_another_task(LAYOUTS[name], task) for task in POLICY_TASKS} == {None}
