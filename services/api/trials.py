"""Routes of trials and their logs."""

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response
from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.job import MAX_TRIALS
from api_schemas.trial import Trial, TrialPage
from services.api import cursor as cursors
from services.api.access import User
from services.api.document import files
from services.api.farm import TheFarm
from services.api.jobs import JobId
from services.api.serving import stored_file
from services.api.tokens import Caller
from services.database.rows import AnyRow
from services.database.tables import trial
from services.errors import NotFound
from services.jobs import views

router = APIRouter(prefix="/v1", tags=["trials"])
TrialId = Annotated[str, Path(pattern=r"^[a-z0-9]{1,20}-[0-9]{3,4}$")]
MCAP = "application/vnd.mcap"


@router.get("/jobs/{job_id}/trials")
async def list_trials(
    job_id: JobId,
    caller: User,
    farm: TheFarm,
    cursor: str | None = None,
    limit: Annotated[int, Query(ge=1, le=1000)] = 1000,
) -> TrialPage:
    """A job's trials in their order."""
    async with farm.database.read() as connection:
        row = await views.job_row(connection, job_id, caller.sees_only)
        wanted = select(trial).where(trial.c.job_number == row.number).order_by(trial.c.ordinal).limit(limit + 1)
        if (after := cursors.decode(cursor, MAX_TRIALS)) is not None:
            wanted = wanted.where(trial.c.ordinal > after)
        shown = await views.show_trials(connection, row, wanted, farm.fleet, farm.clock.now_s())
    following = shown[limit - 1].ordinal if len(shown) > limit else None
    return TrialPage(trials=shown[:limit], next_cursor=cursors.encode(following))


@router.get("/trials/{trial_id}")
async def get_trial(trial_id: TrialId, caller: User, farm: TheFarm) -> Trial:
    """One trial with its attempts."""
    async with farm.database.read() as connection:
        owner_job = await _own_job(connection, trial_id, caller)
        wanted = select(trial).where(trial.c.trial_id == trial_id)
        shown = await views.show_trials(connection, owner_job, wanted, farm.fleet, farm.clock.now_s())
    if not shown:
        raise _missing(trial_id)
    return shown[0]


@router.head("/trials/{trial_id}/log", response_class=Response, responses=files(MCAP))
@router.get("/trials/{trial_id}/log", response_class=Response, responses=files(MCAP))
async def get_log(trial_id: TrialId, request: Request, caller: User, farm: TheFarm) -> Response:
    """The MCAP log of the accepted attempt; byte ranges are served."""
    async with farm.database.read() as connection:
        await _own_job(connection, trial_id, caller)
        row = (await connection.execute(select(trial).where(trial.c.trial_id == trial_id))).one_or_none()
    if row is None:
        raise _missing(trial_id)
    if row.log_sha256 is None:
        raise NotFound("log-not-found", f"Trial {trial_id} is {row.state} and has no log; logs come with accepted outcomes.")
    return await stored_file(request, farm.files, row.log_sha256, MCAP, f"{trial_id}.mcap")


async def _own_job(connection: AsyncConnection, trial_id: str, caller: Caller) -> AnyRow:
    try:
        return await views.job_row(connection, trial_id.rpartition("-")[0], caller.sees_only)
    except NotFound as error:
        raise _missing(trial_id) from error


def _missing(trial_id: str) -> NotFound:
    return NotFound("trial-not-found", f"There is no trial {trial_id} of yours; GET /v1/jobs/<job>/trials lists them.")
