from tests.unit.client_cli.farm_server import JOB_ID


def test_a_job_is_named_and_what_cannot_be_seen_is_shown(farm, trifarm):
    assert trifarm("label", JOB_ID, "--name", "a\u202eb", "--note", "ask Bea").out == f"{JOB_ID}: a\\u202eb (ask Bea)\n"
    assert trifarm("label", JOB_ID, "--name", "sweep", "--json").document["name"] == "sweep"


def test_a_label_without_words_or_with_too_many_is_refused_here(farm, trifarm):
    assert trifarm("label", JOB_ID).code == 2
    said = trifarm("label", JOB_ID, "--note", "x" * 2001)
    assert said.code == 2 and "2001 characters" in said.err


def test_jobs_are_searched_and_the_next_page_too(farm, trifarm):
    said = trifarm("jobs", "--search", "reward")
    assert JOB_ID in said.out and "trifarm jobs --search reward --cursor more" in said.err
    assert "no job matches" in trifarm("jobs", "--search", "other").err


def test_a_job_is_sent_with_its_name_and_note(farm, trifarm, tmp_path):
    weights = tmp_path / "expert.onnx"
    weights.write_bytes(b"abc")
    sent = ("submit", str(weights), "--layout", "pose", "--task", "push", "--name", "sweep", "--note", "third try")
    assert trifarm(*sent).out.strip() == JOB_ID
    request, _ = farm.submissions[-1]
    assert (request.name, request.note) == ("sweep", "third try")
