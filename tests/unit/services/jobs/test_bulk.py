"""On each home: the trials of a job come in by one statement and are as they should be."""

import pytest
from sqlalchemy import event, insert, select

from api_schemas.excitation import IdentificationRequest
from api_schemas.job import MAX_SEED, JobRequest
from services.database.tables import policy, robot, trial
from services.jobs import submission
from services.jobs.order import trial_seed
from services.jobs.submission import Sender
from services.settings import TRIALS_PAGE

A = "a" * 64


@pytest.fixture
async def database(new_database):
    kept = {"weights_format": "onnx", "weights_sha256": A, "weights_bytes": 1, "graph_sha256": A, "manifest": "{}"}
    async with new_database.write() as tx:
        await tx.execute(insert(policy).values(**kept, warnings="[]", owner="ann", created_at="now", digest=A, name="a"))
        await tx.execute(insert(robot).values(robot="r", drain=False, first_seen_at="now"))
    return new_database


async def trials_of(database):
    async with database.read() as connection:
        return (await connection.execute(select(trial).order_by(trial.c.job_number, trial.c.ordinal))).all()


async def test_a_page_of_trials_is_one_statement_and_each_has_its_seed(database):
    asked = []

    def note(_connection, _cursor, statement, _parameters, _context, executemany):
        if "INTO trial " in statement:
            asked.append(executemany)

    event.listen(database._writer.sync_engine, "before_cursor_execute", note)
    async with database.write() as tx:
        wish = JobRequest.model_validate(
            {"policy": A, "task": "push", "trials": TRIALS_PAGE, "seed": MAX_SEED, "priority": "low"}
        )
        job_id, _ = await submission.submit(tx, 1000.0, wish, Sender("ann"))
    rows = await trials_of(database)
    assert asked == [False]
    assert [(row.trial_id, row.seed) for row in rows] == [
        (f"{job_id}-{n:03d}", trial_seed(MAX_SEED, n)) for n in range(TRIALS_PAGE)
    ]
    assert {(row.owner, row.state, row.priority, row.robot_order, row.fence, row.faults) for row in rows} == {
        ("ann", "queued", submission.RANKS[wish.priority], "[]", 0, 0)
    }
    unset = {(row.excitation, row.first_choice, row.departure, row.robot, row.outcome, row.lease_until_s) for row in rows}
    assert unset == {(None,) * 6}, "null, and not the word"


async def test_excitations_keep_their_order_and_their_robot(database):
    async with database.write() as tx:
        wish = IdentificationRequest(robot="r", excitations=("chirps", "hold_poses"), repeats=2)
        await submission.identify(tx, 1000.0, wish, Sender("ann"))
    rows = await trials_of(database)
    assert [row.excitation for row in rows] == ["chirps", "hold_poses"] * 2
    assert {(row.first_choice, row.robot_order) for row in rows} == {("r", '["r"]')}
