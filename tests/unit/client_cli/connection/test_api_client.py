from client_cli.connection.api_client import job_events
from tests.unit.client_cli.farm_server import event


def test_events_and_comments_are_told_apart():
    first, second = event(1, "job_queued"), event(2, "trial_leased", ordinal=0)
    lines = ["event: job_queued", "id: 1", f"data: {first.model_dump_json()}", "", ": alive", ""]
    lines += [f"data:{second.model_dump_json()}", ""]
    assert list(job_events(lines)) == [first, None, second]


def test_data_over_several_lines_are_one_event():
    whole = event(1, "job_queued")
    lines = [f"data: {line}" for line in whole.model_dump_json(indent=1).splitlines()]
    assert list(job_events([*lines, ""])) == [whole]


def test_an_event_that_was_cut_is_left_out():
    assert list(job_events(['data: {"id": 1,'])) == []
