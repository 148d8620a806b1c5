import pytest

from api_schemas.excitation import ExcitationName
from api_schemas.job import JobState
from tests.unit.client_cli.farm_server import JOB_ID, event


def test_all_excitations_are_asked_for_and_only_the_id_is_printed(farm, trifarm):
    ended = trifarm("identify", "--robot", "any")
    assert (ended.code, ended.out) == (0, f"{JOB_ID}\n")
    ((request, key),) = farm.identifications
    assert (request.robot, request.excitations, request.repeats, request.seed) == ("any", tuple(ExcitationName), 1, None)
    assert key


def test_some_excitations_several_times(farm, trifarm):
    flags = ("--excitation", "chirps", "--excitation", "hold_poses", "--repeats", "3", "--seed", "5", "--idempotency-key", "mine")
    document = trifarm("identify", "--robot", "robot-2", *flags, "--json").document
    ((request, key),) = farm.identifications
    assert (request.robot, request.excitations, request.repeats, request.seed) == ("robot-2", ("chirps", "hold_poses"), 3, 5)
    assert key == "mine"
    assert (document["robot"], document["policy"], document["folder"], document["logs"]) == ("robot-2", None, None, None)


@pytest.mark.parametrize(("state", "code"), [(JobState.SUCCEEDED, 0), (JobState.FAILED, 3)])
def test_to_waits_and_fetches(farm, trifarm, tmp_path, state, code):
    farm.state = JobState.RUNNING
    farm.logs = {f"{JOB_ID}-{n:03d}": bytes([n]) * 100 for n in range(2)}
    farm.streams = [[event(1, "job_queued"), event(2, "job_ended", done=2, state=state)]]
    flags = ("--excitation", "chirps", "--repeats", "2", "--to", str(tmp_path / "logs"))
    ended = trifarm("identify", "--robot", "robot-2", *flags, "--json")
    assert ended.code == code
    assert ended.document["state"] == state
    if code:
        assert ended.document["logs"] is None
        assert not (tmp_path / "logs").exists()
    else:
        assert ended.document["logs"] == [str(tmp_path / "logs" / f"trial-00{n}.mcap") for n in range(2)]
        assert (tmp_path / "logs" / "report.json").exists()
        assert "2 excitations recorded" in ended.err


def test_a_folder_that_holds_another_job_is_refused_before_anything_is_recorded(farm, trifarm, tmp_path):
    (tmp_path / "report.json").write_text('{"job_id": "jother"}')
    ended = trifarm("identify", "--robot", "any", "--to", str(tmp_path))
    assert ended.code == 2
    assert "holds the logs of job jother" in ended.err
    assert not farm.identifications


def test_the_same_job_may_be_fetched_again_by_its_key(farm, trifarm, tmp_path):
    (tmp_path / "report.json").write_text(f'{{"job_id": "{JOB_ID}"}}')
    farm.streams = [[event(1, "job_queued"), event(2, "job_ended", done=1, state=JobState.SUCCEEDED)]]
    flags = ("--excitation", "chirps", "--idempotency-key", "mine", "--to", str(tmp_path))
    ended = trifarm("identify", "--robot", "any", *flags)
    assert ended.code == 0, ended.err


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("--robot", "Robot 2"), "robot is 'Robot 2' and should match"),
        (("--robot", "any", "--excitation", "chirps", "--excitation", "chirps"), "chirps is named more than once"),
        (("--robot", "any", "--excitation", "dance"), "dance"),
        (("--robot", "any", "--repeats", "21"), "equal to 20"),
        ((), "--robot"),
    ],
)
def test_what_cannot_be_asked_is_refused_here(farm, trifarm, flags, said):
    ended = trifarm("identify", *flags)
    assert ended.code == 2
    assert said in ended.err
    assert not farm.identifications
