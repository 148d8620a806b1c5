"""Large jobs: trials come page by page, whoever is killed; the report is made before the end, which is one short transaction."""

import pytest
from sqlalchemy import func, insert, select, update

from api_schemas.job import JobRequest, JobState
from api_schemas.report import Report, read_report
from api_schemas.robot import OutcomeReport
from api_schemas.trial import Fault, Outcome, OutcomeKind, TrialState
from services.database.tables import attempt, job, policy, report, robot, trial
from services.dispatcher.large_jobs import LargeJobs
from services.errors import Refused, TooMany
from services.jobs import cancellation, completion, filling, reports
from services.jobs.clock import FarmClock
from services.jobs.lists import trials_of
from services.jobs.order import trial_seed
from services.jobs.signals import Signals
from services.jobs.submission import Sender, submit
from tests.unit.services.dispatcher.conftest import POLICY

PAGE, TRIALS = 3, 40
AHEAD = PAGE * filling.PAGES_AHEAD


class KilledError(Exception):
    """Stands for the end of a process in the midst of a transaction."""


@pytest.fixture
async def database(new_database):
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(POLICY))
        await tx.execute(insert(robot), [{"robot": name, "drain": False, "first_seen_at": "now"} for name in "ab"])
    return new_database


async def send(database, *, trials=TRIALS, page=PAGE, sender=Sender("ann"), **more):
    wish = JobRequest.model_validate({"policy": POLICY["digest"], "task": "push", "trials": trials, "seed": 7} | more)
    async with database.write() as tx:
        return (await submit(tx, 1000.0, wish, sender, page=page))[0]


def worker(database, page=PAGE):
    return LargeJobs(database, FarmClock.start(), Signals(), page)


async def row_of(database):
    async with database.read() as connection:
        return (await connection.execute(select(job))).one()


async def made(database):
    async with database.read() as connection:
        return (await connection.execute(select(trial.c.ordinal, trial.c.seed).order_by(trial.c.ordinal))).all()


def outcome_of(ordinal):
    succeeded = ordinal % 3 != 0
    kind = OutcomeKind.SUCCEEDED if succeeded else OutcomeKind.POLICY_ERROR
    fault = Fault.NONE if succeeded else Fault.POLICY
    return Outcome(kind=kind, fault=fault, reason=f"said {ordinal}")


async def write_outcomes(database, *, but=0):
    """Ends what exists as robots would have it ended, all at once; ``but`` the last so many of the job."""
    async with database.write() as tx:
        rows = (await tx.execute(select(trial).where(trial.c.state == TrialState.QUEUED, trial.c.ordinal < TRIALS - but))).all()
        for row in rows:
            told = outcome_of(row.ordinal).model_dump_json()
            done = {"state": "done", "robot": "ab"[row.ordinal % 2], "outcome": told, "fence": 1, "log_sha256": "f" * 64}
            await tx.execute(update(trial).where(trial.c.trial_id == row.trial_id).values(**done))
            tried = {
                "trial_id": row.trial_id,
                "fence": 1,
                "job_number": row.job_number,
                "robot": done["robot"],
                "state": "accepted",
            }
            await tx.execute(insert(attempt).values(**tried, started_at="then", ended_at="now", outcome=told))
        successes = sum(row.ordinal % 3 != 0 for row in rows)
        counts = {"trials_done": job.c.trials_done + len(rows), "successes": job.c.successes + successes, "state": "running"}
        await tx.execute(update(job).values(**counts, started_at="2026-11-25T20:00:00+00:00"))


async def do_all(database, *, but=0):
    while (await row_of(database)).trials_done < TRIALS - but:
        await worker(database).look()
        await write_outcomes(database, but=but)


async def test_the_first_page_comes_with_the_job_and_others_ahead_of_the_robots(database):
    await send(database)
    assert [each.ordinal for each in await made(database)] == list(range(PAGE)) and (await row_of(database)).trials_made == PAGE
    await worker(database).look()
    assert len(await made(database)) == AHEAD, "as many as keep robots busy, and no more"
    await worker(database).look()
    assert len(await made(database)) == AHEAD
    await do_all(database)
    rows = await made(database)
    assert [(each.ordinal, each.seed) for each in rows] == [(at, trial_seed(7, at)) for at in range(TRIALS)]


async def test_a_job_within_a_page_is_made_with_all_of_its_trials_and_is_none_of_this(database):
    await send(database, trials=PAGE)
    assert (await row_of(database)).trials_made is None
    async with database.read() as connection:
        assert await filling.unfinished(connection) == []


async def test_who_is_killed_within_a_page_leaves_nothing_of_it_and_the_next_goes_on(database, monkeypatch):
    await send(database)
    make = filling.make

    async def killed(*given, **more):
        await make(*given, **more)
        raise KilledError

    with monkeypatch.context() as patched:
        patched.setattr(filling, "make", killed)
        with pytest.raises(KilledError):
            await worker(database).look()
    assert (len(await made(database)), (await row_of(database)).trials_made) == (PAGE, PAGE)
    await worker(database).look()
    assert len(await made(database)) == AHEAD


async def test_two_who_saw_the_same_make_a_page_once(database):
    await send(database)
    async with database.read() as connection:
        (seen,) = await filling.unfinished(connection)
    told = []
    for _ in range(2):
        async with database.write() as tx:
            told.append(await filling.fill(tx, seen, PAGE))
    assert told == [True, False] and [each.ordinal for each in await made(database)] == list(range(2 * PAGE))


async def test_a_cancelled_job_gets_no_more_trials_and_those_that_never_came_count_as_not_succeeded(database):
    await send(database)
    await worker(database).look()
    async with database.write() as tx:
        await cancellation.cancel(tx, 1001.0, 1)
    await worker(database).look()
    row = await row_of(database)
    assert (row.state, len(await made(database)), row.trials_made) == (JobState.CANCELLED, AHEAD, AHEAD)
    assert row.outcomes == "0" * TRIALS
    async with database.read() as connection:
        assert await filling.unfinished(connection) == [], "nothing is left to do"


async def test_the_job_ends_with_the_report_that_one_transaction_would_have_made(database, monkeypatch):
    monkeypatch.setattr("services.dispatcher.large_jobs.READ_AT_ONCE", 7)
    await send(database)
    await do_all(database)
    assert (await row_of(database)).state == JobState.RUNNING, "until its report is there"
    await worker(database).look()
    row = await row_of(database)
    assert row.state == JobState.SUCCEEDED and row.outcomes == "".join("01"[at % 3 != 0] for at in range(TRIALS))
    async with database.read() as connection:
        kept = (await connection.execute(select(report))).one()
        trials = await trials_of(connection, 1)
        attempts = await reports.attempts_of(connection, trials)
    assert kept.body == reports.body_of(reports.compose(row, trials, attempts, reports.versions()))
    told = read_report(kept.body)
    assert isinstance(told, Report) and told.successes == row.successes == 26


async def test_who_is_killed_before_the_end_leaves_a_job_that_ends_at_the_next_look(database, monkeypatch):
    await send(database)
    await do_all(database)
    store = reports.store

    async def killed(*given):
        await store(*given)
        raise KilledError

    with monkeypatch.context() as patched:
        patched.setattr(reports, "store", killed)
        await worker(database).look()
    assert (await row_of(database)).state == JobState.RUNNING
    for _ in range(2):
        await worker(database).look()
    async with database.read() as connection:
        assert (await connection.execute(select(func.count()).select_from(report))).scalar_one() == 1
    assert (await row_of(database)).state == JobState.SUCCEEDED


async def test_a_job_that_is_cancelled_while_its_report_is_made_is_cancelled(database):
    await send(database)
    await do_all(database)
    async with database.write() as tx:
        await cancellation.cancel(tx, 1001.0, 1)
        assert not await completion.end_large(tx, 1001.0, "now", 1, b"", "")
    assert (await row_of(database)).state == JobState.CANCELLED


async def test_the_last_outcome_leaves_the_end_to_the_report(database):
    job_id = await send(database)
    await do_all(database, but=1)
    await worker(database).look()
    async with database.write() as tx:
        last = f"{job_id}-{TRIALS - 1:03d}"
        leased = {"state": "running", "robot": "a", "fence": 1, "lease_until_s": 2000.0}
        await tx.execute(update(trial).where(trial.c.trial_id == last).values(**leased))
        tried = {"trial_id": last, "fence": 1, "job_number": 1, "robot": "a", "state": "open", "started_at": "now"}
        await tx.execute(insert(attempt).values(**tried, log_sha256="f" * 64))
        await tx.execute(update(job).values(trials_active=1))
    told = OutcomeReport(robot="a", fence=1, outcome=outcome_of(TRIALS - 1), log_sha256="f" * 64)
    async with database.write() as tx:
        ending = await completion.accept(tx, 1001.0, last, told, log_bytes=4, max_attempts=1)
    assert (ending.done, ending.job_ended) == (True, False)
    await worker(database).look()
    assert (await row_of(database)).state == JobState.SUCCEEDED


async def test_goals_that_are_taken_of_a_large_job_are_those_that_it_will_have(database):
    first = await send(database)
    await send(database, trials=TRIALS // 2, like=first, seed=None)
    async with database.read() as connection:
        seeds = select(trial.c.seed).where(trial.c.job_number == 2).order_by(trial.c.ordinal)
        assert (await connection.execute(seeds)).scalars().all() == [trial_seed(7, at) for at in range(TRIALS // 2)]


async def test_a_user_has_so_many_trials_and_no_more(database):
    with pytest.raises(Refused, match="may have 30 trials, not 40"):
        await send(database, sender=Sender("ann", may_ask=30))
    bounded = Sender("ann", may_queue_trials=TRIALS + 5)
    await send(database, sender=bounded)
    with pytest.raises(TooMany, match="ann has 40 trials that are not done and may have 45; 40 more are too many"):
        await send(database, sender=bounded)
    await send(database, trials=5, sender=bounded)
    await send(database, sender=Sender("bob", may_queue_trials=TRIALS))
