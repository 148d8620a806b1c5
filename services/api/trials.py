"""Routes of trials and their logs."""

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy.ext.asyncio import AsyncConnection

from api_schemas.trial import Trial, TrialPage
from report_views.trial_table import as_csv
from services.api.access import User
from services.api.document import Responses, files
from services.api.farm import Farm, TheFarm
from services.api.jobs import JobId
from services.api.paging import by_trial, encode
from services.api.serving import stored_file
from services.database.pages import Asked
from services.database.rows import AnyRow
from services.errors import NotFound
from services.jobs import lists, views
from services.tokens import Caller
from services.turns import Turns

router = APIRouter(prefix="/v1", tags=["trials"])
TrialId = Annotated[str, Path(pattern=r"^[a-z0-9]{1,20}-[0-9]{3,5}$")]
MCAP = "application/vnd.mcap"
CSV = "text/csv; charset=utf-8"
TABLE: Responses = {200: {"content": {"text/csv": {"schema": {"type": "string"}}}}}
CSV_AT_ONCE = 500


@router.get("/jobs/{job_id}/trials", response_model=TrialPage)
async def list_trials(
    job_id: JobId, request: Request, caller: User, farm: TheFarm, asked: Annotated[Asked, Depends(by_trial)]
) -> Response:
    """A job's trials in their order; owners take turns, since a page of a thousand takes the services tens of milliseconds."""
    turns: Turns = request.app.state.lists
    async with turns.of(caller.owner), farm.database.read() as connection:
        row = await views.job_row(connection, job_id, caller.sees_only)
        page = await lists.trial_page(connection, row.number, asked)
        shown = await views.show_trials(connection, row, page.entries, farm.fleet, farm.clock.now_s())
        body = TrialPage(trials=shown, next_cursor=encode(page.following)).model_dump_json()
    return Response(body, media_type="application/json")


@router.get("/jobs/{job_id}/trials.csv", response_class=Response, responses=TABLE)
async def trials_as_csv(job_id: JobId, caller: User, farm: TheFarm) -> Response:
    """A job's trials as a table, one row a trial; a long one is sent while it is read."""
    async with farm.database.read() as connection:
        row = await views.job_row(connection, job_id, caller.sees_only)
    headers = {"Content-Disposition": f'attachment; filename="trials-{job_id}.csv"'}
    return StreamingResponse(_lines_of(row, farm), media_type=CSV, headers=headers)


async def _lines_of(row: AnyRow, farm: Farm) -> AsyncIterator[str]:
    asked = Asked(CSV_AT_ONCE)
    while True:
        async with farm.database.read() as connection:
            page = await lists.trial_page(connection, row.number, asked)
            shown = await views.show_trials(connection, row, page.entries, farm.fleet, farm.clock.now_s())
        yield await asyncio.to_thread(as_csv, shown, with_names=asked.after is None)
        if page.following is None:
            return
        asked = Asked(CSV_AT_ONCE, page.following)


@router.get("/trials/{trial_id}")
async def get_trial(trial_id: TrialId, caller: User, farm: TheFarm) -> Trial:
    """One trial with its attempts."""
    async with farm.database.read() as connection:
        owner_job = await _own_job(connection, trial_id, caller)
        row = await lists.trial_row(connection, trial_id)
        if row is None:
            raise _missing(trial_id)
        (shown,) = await views.show_trials(connection, owner_job, [row], farm.fleet, farm.clock.now_s())
    return shown


@router.head("/trials/{trial_id}/log", response_class=Response, responses=files(MCAP))
@router.get("/trials/{trial_id}/log", response_class=Response, responses=files(MCAP))
async def get_log(trial_id: TrialId, request: Request, caller: User, farm: TheFarm) -> Response:
    """The MCAP log of the accepted attempt; byte ranges are served."""
    async with farm.database.read() as connection:
        await _own_job(connection, trial_id, caller)
        row = await lists.trial_row(connection, trial_id)
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
