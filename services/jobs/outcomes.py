"""How the trials of jobs ended, in their order: one character each, so that policies are compared without reading a trial."""

from collections.abc import Sequence
from itertools import takewhile

from sqlalchemy import func, select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import JobState
from api_schemas.trial import OutcomeKind, TrialState
from services.database.rows import AnyRow
from services.database.tables import trial

SUCCEEDED, NOT = "1", "0"
BEGINS = f'{{"kind":"{OutcomeKind.SUCCEEDED}"'
"""The first field of an outcome as it is stored."""
_DID = (func.substr(trial.c.outcome, 1, len(BEGINS)) == BEGINS).label("succeeded")


async def of_job(tx: AsyncConnection, ended: AnyRow) -> str | None:
    """The outcomes that count of a job that has ended; None of one that nothing counts of.

    Of a cancelled job those that were not done are not succeeded; see ``leaderboard.TRIALS``.
    """
    if ended.policy is None:
        return None
    wanted = select(trial.c.state, trial.c.outcome).where(trial.c.job_number == ended.number).order_by(trial.c.ordinal)
    return counted((await tx.execute(wanted.limit(ended.counted_trials))).all(), ended.state)


def counted(rows: Sequence[AnyRow], state: str) -> str:
    """What counts of some trials of a job that ended in this state."""
    if state != JobState.CANCELLED:
        rows = [row for row in rows if row.state == TrialState.DONE]
    return "".join(map(of_row, rows))


def of_row(row: AnyRow) -> str:
    """How one trial ended."""
    return SUCCEEDED if row.state == TrialState.DONE and row.outcome.startswith(BEGINS) else NOT


def unmade(row: AnyRow, made: int) -> str:
    """The same of the trials of a large job that never came to be, beside those that were ``made``."""
    return NOT * (row.trials - made) if row.state == JobState.CANCELLED else ""


async def in_order(connection: AsyncConnection, numbers: Sequence[int]) -> dict[int, list[bool]]:
    """How the first trials of each job ended, up to one that is not done: which end first may depend on how they end."""
    columns = (trial.c.job_number, trial.c.state, _DID)
    wanted = select(*columns).where(trial.c.job_number.in_(numbers)).order_by(trial.c.job_number, trial.c.ordinal)
    of_each: dict[int, list[AnyRow]] = {number: [] for number in numbers}
    for row in await connection.execute(wanted):
        of_each[row.job_number].append(row)
    return {
        number: [bool(row.succeeded) for row in takewhile(lambda row: row.state == TrialState.DONE, rows)]
        for number, rows in of_each.items()
    }
