import json

import pytest

from api_schemas.job import JobState
from tests.unit.client_cli.farm_server import JOB_ID

LOGS = {f"{JOB_ID}-{n:03d}": bytes([n]) * 700_000 for n in range(3)}


@pytest.fixture
def folder(farm, tmp_path):
    farm.logs = dict(LOGS)
    return tmp_path / "new" / "logs"


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def complete(farm):
    return {f"trial-{n:03d}.mcap": log for n, log in enumerate(LOGS.values())} | {"report.json": farm.report}


def test_fetch_writes_logs_and_the_report_byte_by_byte(farm, trifarm, folder):
    ended = trifarm("fetch", JOB_ID, "--to", str(folder), "--json")
    assert ended.code == 0
    assert files(folder) == complete(farm)
    assert ended.document["received_bytes"] == 2_100_000
    assert ended.document["report"] == str(folder / "report.json")


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_the_trials_are_fetched_as_a_table(farm, trifarm, tmp_path, suffix):
    import pandas

    table = tmp_path / f"trials.{suffix}"
    assert trifarm("fetch", JOB_ID, "--table", str(table)).code == 0
    read = pandas.read_csv(table) if suffix == "csv" else pandas.read_parquet(table)
    assert read.trial.tolist() == sorted(read.trial) and len(read) > 0
    assert [path.name for path in tmp_path.iterdir()] == [table.name], "no log was asked for"


def test_json_says_where_the_table_is_with_logs_and_without(farm, trifarm, folder, tmp_path):
    table = tmp_path / "trials.csv"
    alone = trifarm("fetch", JOB_ID, "--table", str(table), "--json")
    assert (alone.code, alone.document) == (0, {"job_id": JOB_ID, "table": str(table)})
    both = trifarm("fetch", JOB_ID, "--table", str(table), "--to", str(folder), "--json").document
    assert both["table"] == str(table) and len(both["logs"]) == len(LOGS)
    assert trifarm("fetch", JOB_ID, "--to", str(folder), "--json").document["table"] is None


def test_a_table_of_no_known_kind_and_nothing_to_fetch_are_refused(farm, trifarm, tmp_path):
    for arguments in (["--table", str(tmp_path / "x.xls")], []):
        ended = trifarm("fetch", JOB_ID, *arguments)
        assert ended.code == 2 and (".parquet" in ended.err or "--table FILE" in ended.err)
    assert not list(tmp_path.iterdir())


def test_operators_fetch_the_truth_too_and_it_is_checked(farm, trifarm, folder):
    farm.truths = {0: b"truth of 0", 2: b"truth of 2"}
    ended = trifarm("fetch", JOB_ID, "--to", str(folder), "--truth", "--json")
    truths = {f"trial-{n:03d}.truth.mcap": truth for n, truth in farm.truths.items()}
    assert files(folder) == complete(farm) | truths
    assert ended.document["truths"] == [str(folder / name) for name in truths]
    (folder / "trial-002.truth.mcap").write_bytes(b"damaged")
    assert trifarm("fetch", JOB_ID, "--to", str(folder), "--truth", "--json").document["already_there"] == 4
    assert files(folder) == complete(farm) | truths


def test_who_may_not_have_the_truth_is_told_what_to_leave_out(farm, trifarm, folder):
    farm.truths, farm.truths_for_all = {0: b"truth of 0"}, False
    ended = trifarm("fetch", JOB_ID, "--to", str(folder), "--truth")
    assert ended.code == 5
    assert "scope operate; without --truth the logs alone are fetched" in ended.err
    assert "HTTP 403" not in ended.err


def test_fetch_again_brings_only_what_is_missing(farm, trifarm, folder):
    trifarm("fetch", JOB_ID, "--to", str(folder))
    (folder / "trial-001.mcap").write_bytes(b"damaged")
    farm.ranges.clear()
    ended = trifarm("fetch", JOB_ID, "--to", str(folder), "--json")
    assert ended.document["already_there"] == 2
    assert len(farm.ranges) == 1
    assert files(folder) == complete(farm)


def test_a_part_is_resumed(farm, trifarm, folder):
    folder.mkdir(parents=True)
    (folder / "trial-002.mcap.part").write_bytes(LOGS[f"{JOB_ID}-002"][:123_456])
    trifarm("fetch", JOB_ID, "--to", str(folder), "--jobs", "1")
    assert "bytes=123456-" in farm.ranges
    assert files(folder) == complete(farm)


@pytest.mark.parametrize("part", [b"other" * 10, b"x" * 700_000, b"x" * 800_000])
def test_a_part_of_something_else_is_begun_anew(farm, trifarm, folder, part):
    folder.mkdir(parents=True)
    (folder / "trial-000.mcap.part").write_bytes(part)
    assert trifarm("fetch", JOB_ID, "--to", str(folder)).code == 0
    assert files(folder) == complete(farm)


def test_a_broken_transfer_is_resumed_at_once(farm, trifarm, folder):
    farm.trials, farm.log_cuts = 1, [400_000]
    assert trifarm("fetch", JOB_ID, "--to", str(folder)).code == 0
    assert farm.ranges[0] is None
    assert farm.ranges[1] not in {None, "bytes=0-"}


def test_a_log_that_is_not_what_the_server_says_never_gets_its_name(farm, trifarm, folder):
    class Lying(dict):
        def __getitem__(self, key):
            return b"y" * 700_000

    farm.logs = Lying(LOGS)
    ended = trifarm("fetch", JOB_ID, "--to", str(folder))
    assert ended.code == 1
    assert "another SHA-256" in ended.err
    assert [name for name in files(folder) if not name.endswith(".part")] == ["job_id.txt"]


def test_another_jobs_folder_is_left_alone(farm, trifarm, folder):
    folder.mkdir(parents=True)
    (folder / "report.json").write_text(json.dumps({"job_id": "jother"}))
    ended = trifarm("fetch", JOB_ID, "--to", str(folder))
    assert ended.code == 2
    assert "holds the logs of job jother" in ended.err


def test_a_running_job_has_nothing_to_fetch_yet(farm, trifarm, folder):
    farm.state = JobState.RUNNING
    ended = trifarm("fetch", JOB_ID, "--to", str(folder))
    assert ended.code == 1
    assert "is still running (0 of 3 trials done)" in ended.err


def test_a_cancelled_job_gives_its_logs_but_no_report(farm, trifarm, folder):
    farm.state = JobState.CANCELLED
    del farm.logs[f"{JOB_ID}-002"]
    ended = trifarm("fetch", JOB_ID, "--to", str(folder), "--json")
    assert ended.code == 3
    assert ended.document["report"] is None
    assert sorted(files(folder)) == ["job_id.txt", "trial-000.mcap", "trial-001.mcap"]


def test_a_folder_that_is_not_complete_is_of_its_job_all_the_same(farm, trifarm, folder):
    farm.state = JobState.FAILED
    assert trifarm("fetch", JOB_ID, "--to", str(folder)).code == 3
    before = files(folder)
    for command in (("fetch", "jother"), ("identify", "--robot", "any")):
        ended = trifarm(*command, "--to", str(folder))
        assert ended.code == 2
        assert f"holds the logs of job {JOB_ID}; choose another folder" in ended.err
        assert files(folder) == before
    farm.state = JobState.SUCCEEDED  # as after it was queued again
    assert trifarm("fetch", JOB_ID, "--to", str(folder), "--json").document["already_there"] == 3
    assert files(folder) == complete(farm)


def test_an_interrupted_folder_is_left_alone_by_others_and_resumed_by_its_job(farm, trifarm, folder):
    farm.trials, farm.log_cuts = 1, [400_000] * 3
    assert trifarm("fetch", JOB_ID, "--to", str(folder)).code not in {0, 2}
    before = files(folder)
    assert before["job_id.txt"].decode() == f"{JOB_ID}\n" and "trial-000.mcap.part" in before
    assert trifarm("fetch", "jother", "--to", str(folder)).code == 2
    assert files(folder) == before
    farm.trials = 3
    assert trifarm("fetch", JOB_ID, "--to", str(folder)).code == 0
    assert files(folder) == complete(farm)


def test_logs_of_nobody_knows_which_job_are_left_alone_until_somebody_says_it(farm, trifarm, folder):
    folder.mkdir(parents=True)
    (folder / "trial-000.mcap").write_bytes(LOGS[f"{JOB_ID}-000"])
    ended = trifarm("fetch", JOB_ID, "--to", str(folder))
    assert ended.code == 2
    assert "holds trial-000.mcap and does not say of which job" in ended.err
    assert list(files(folder)) == ["trial-000.mcap"]
    (folder / "job_id.txt").write_text(JOB_ID)
    assert trifarm("fetch", JOB_ID, "--to", str(folder), "--json").document["already_there"] == 1
    assert files(folder) == complete(farm)
