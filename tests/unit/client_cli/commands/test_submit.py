import pytest

from api_schemas.job import JobState
from api_schemas.policy import LAYOUTS
from tests.unit.client_cli.farm_server import JOB_ID, event


@pytest.fixture
def weights(tmp_path):
    path = tmp_path / "expert.onnx"
    path.write_bytes(b"abc")
    return str(path)


def test_submit_uploads_queues_and_prints_only_the_id(farm, trifarm, weights):
    ended = trifarm("submit", weights, "--layout", "pose", "--task", "lift", "--trials", "5", "--seed", "9")
    assert (ended.code, ended.out) == (0, f"{JOB_ID}\n")
    (request, key) = farm.submissions[0]
    assert (request.task, request.trials, request.seed) == ("lift", 5, 9)
    assert farm.uploads == ["expert.onnx"]
    assert key


def test_an_upload_waits_for_others_of_its_owner_and_is_sent_whole_again(farm, trifarm, weights):
    farm.busy = {"uploads": 2}
    assert trifarm("submit", weights, "--layout", "pose", "--task", "lift").code == 0
    assert (farm.busy, farm.uploads) == ({"uploads": 0}, ["expert.onnx"])


def test_another_object_and_priority_are_asked_for(farm, trifarm, weights):
    flags = ("--object", "sphere", "--object-scale", "0.8", "--priority", "low")
    assert trifarm("submit", weights, "--layout", "pose", "--task", "lift", *flags).code == 0
    ((request, _),) = farm.submissions
    assert (request.object, request.object_scale, request.priority) == ("sphere", 0.8, "low")


@pytest.mark.parametrize("flags", [("--task", "identify"), ("--task", "lift", "--object-scale", "1.3")])
def test_what_no_policy_can_be_asked_is_refused_here(farm, trifarm, weights, flags):
    assert trifarm("submit", weights, "--layout", "pose", *flags).code == 2
    assert not farm.uploads


def test_submit_json_is_the_job(farm, trifarm, weights):
    farm.warnings = ("the output is constant",)
    ended = trifarm("submit", weights, "--layout", "pose", "--task", "push", "--json", "--idempotency-key", "mine")
    assert ended.document["job_id"] == JOB_ID
    assert ended.err == "warning: the output is constant\n"
    assert farm.submissions[0][1] == "mine"


def test_a_lost_answer_is_asked_for_again_under_the_same_key(farm, trifarm, weights):
    farm.post_answers_lost = 1
    assert trifarm("submit", weights, "--layout", "pose", "--task", "push").code == 0
    (first, second) = farm.submissions
    assert first == second


@pytest.mark.parametrize(("state", "code"), [(JobState.SUCCEEDED, 0), (JobState.FAILED, 3), (JobState.CANCELLED, 3)])
def test_wait_ends_with_the_job(farm, trifarm, weights, state, code):
    farm.state = JobState.RUNNING
    farm.streams = [[event(1, "job_queued"), event(2, "job_ended", done=3, state=state)]]
    ended = trifarm("submit", weights, "--layout", "pose", "--task", "push", "--wait", "--json")
    assert ended.code == code
    assert ended.document["state"] == state


def test_a_bad_file_is_refused_before_anything_is_sent(farm, trifarm):
    ended = trifarm("submit", "absent.onnx", "--layout", "pose", "--task", "push", "--json")
    assert ended.code == 2
    assert ended.document["error"]["detail"] == "there is no file absent.onnx"
    assert not farm.uploads


def test_the_help_names_the_command_that_lists_the_layouts(trifarm):
    words = " ".join(trifarm("submit", "--help").out.replace("│", " ").split())
    assert "its name; 'trifarm layouts' lists them" in words
    assert all(name in trifarm("layouts").out for name in LAYOUTS)
