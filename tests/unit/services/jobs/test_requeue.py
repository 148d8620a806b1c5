"""A failed job goes on where it was, and its history still ends where it ends."""

from types import SimpleNamespace

import pytest
from sqlalchemy import insert, select, update

from api_schemas.job import FINAL_JOB_STATES, JobRequest, JobState
from api_schemas.robot import OutcomeReport
from api_schemas.trial import Fault, Outcome, OutcomeKind
from services.api.jobs import requeue_job
from services.database.tables import job, policy, robot, trial
from services.errors import Conflict
from services.files.store import FileStore
from services.jobs.completion import accept, fault
from services.jobs.events import events_after
from services.jobs.requeue import check_logs, requeue
from services.jobs.submission import submit
from tests.unit.services.dispatcher.conftest import POLICY
from tests.unit.services.jobs.test_pinning import ANN, NOW_S, asked, end, take


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(robot), [{"robot": name, "drain": False, "first_seen_at": "now"} for name in "ab"])
    return new_database


async def failed(database, fleet):
    """An identification with one of two excitations recorded, whose other one failed as often as it may."""
    await asked(database, "a")
    await end(database, fleet, await take(database, "a", fleet))
    claim = await take(database, "a", fleet)
    async with database.write() as tx:
        await fault(tx, NOW_S, claim, "the power went", 1)
    fleet.freed(claim, done=False)


async def test_what_was_done_is_kept_and_the_rest_is_tried_anew(database, fleet_of):
    fleet = fleet_of("a", "b")
    await failed(database, fleet)
    async with database.write() as tx:
        row = (await tx.execute(select(job))).one()
        assert (row.state, row.trials_done, row.reason is None) == (JobState.FAILED, 1, False)
        await requeue(tx, NOW_S, row.number)
        row = (await tx.execute(select(job))).one()
        assert (row.state, row.trials_done, row.reason, row.ended_at) == (JobState.RUNNING, 1, None, None)
        assert (await tx.execute(select(trial.c.state, trial.c.faults).order_by(trial.c.ordinal))).all() == [
            ("done", 0),
            ("queued", 0),
        ]
        assert "job_ended" not in [event.kind for event in await events_after(tx, row.number, 0)]
        with pytest.raises(Conflict, match="is running; only a failed job"):
            await requeue(tx, NOW_S, row.number)
    ending = await end(database, fleet, await take(database, "a", fleet), OutcomeKind.RECORDED, Fault.NONE)
    assert ending.job_ended
    async with database.read() as connection:
        history = await events_after(connection, row.number, 0)
    assert [event.kind for event in history].count("job_ended") == 1 and history[-1].kind == "job_ended"
    assert [event.state for event in history if event.kind == "job_gave_up"] == [JobState.RUNNING]


async def test_a_job_whose_report_would_name_logs_that_are_gone_is_not_queued_again(database, fleet_of, tmp_path):
    async def log():
        yield b"log"

    files = FileStore(tmp_path)
    await failed(database, fleet_of("a", "b"))
    async with database.read() as connection:
        job_id = (await connection.execute(select(job.c.job_id))).scalar_one()
    with pytest.raises(Conflict, match=rf"Logs of job {job_id} are gone \(trial 0\)") as caught:
        await requeue_job(job_id, SimpleNamespace(sees_only=None), SimpleNamespace(database=database, files=files))
    assert (caught.value.slug, caught.value.members) == ("logs-gone", {"trials": [0]})
    sha256 = (await files.put(log(), limit_bytes=9)).sha256
    async with database.write() as tx:
        await tx.execute(update(trial).where(trial.c.log_sha256.is_not(None)).values(log_sha256=sha256))
    await check_logs(database, files, 1)


async def test_a_job_whose_robots_still_stop_its_trials_has_to_wait_and_its_history_ends_nowhere_in_between(database, fleet_of):
    fleet = fleet_of("a", "b")
    async with database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
        wish = JobRequest.model_validate({"policy": POLICY["digest"], "task": "push", "trials": 4})
        await submit(tx, NOW_S, wish, ANN)
    first, second = [await take(database, name, fleet) for name in "ab"]
    async with database.write() as tx:
        await fault(tx, NOW_S, first, "the power went", 1)
    with pytest.raises(Conflict, match="Robots are still stopping trials of job"):
        async with database.write() as tx:
            await requeue(tx, NOW_S, 1)
    stopped = Outcome(kind=OutcomeKind.CANCELLED, fault=Fault.NONE, reason="the job was cancelled")
    report = OutcomeReport(robot="b", fence=second.fence, outcome=stopped, log_sha256=None)
    async with database.write() as tx:
        await accept(tx, NOW_S, second.trial_id, report, log_bytes=None, max_attempts=1)
        await requeue(tx, NOW_S, 1)
    async with database.read() as connection:
        row = (await connection.execute(select(job))).one()
        history = await events_after(connection, 1, 0)
    assert (row.state, row.platform_faults, row.trials_active) == (JobState.RUNNING, 1, 0)
    assert [event.kind for event in history if event.state in FINAL_JOB_STATES] == []
