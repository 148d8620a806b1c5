"""Routes of why a trial failed: asked once, computed beside all requests, read as often as one likes."""

from fastapi import APIRouter

from api_schemas.token import Scope
from api_schemas.trial import Trial
from api_schemas.why import TrialWhy
from services.api.access import User
from services.api.document import refusals
from services.api.farm import Farm, TheFarm
from services.api.jobs import JobId
from services.api.truth import Ordinal
from services.database.rows import AnyRow
from services.errors import NotFound
from services.jobs import views, whys
from services.jobs.lists import trial_at
from services.tokens import Caller

router = APIRouter(prefix="/v1/jobs/{job_id}/trials/{ordinal}", tags=["trials"])


@router.post("/why", responses=refusals(409))
async def ask_why(job_id: JobId, ordinal: Ordinal, caller: User, farm: TheFarm) -> TrialWhy:
    """Asks why a trial failed. Replays without some of its robot's effects take a minute or so; GET shows the answer."""
    row = await _trial(farm, job_id, ordinal, caller)
    async with farm.database.write() as tx:
        await whys.ask(tx, row, _budget(farm), farm.clock.now_s(), as_operator=caller.may(Scope.OPERATE))
        return await whys.show(tx, row, _budget(farm), as_operator=caller.may(Scope.OPERATE))


@router.get("/why")
async def get_why(job_id: JobId, ordinal: Ordinal, caller: User, farm: TheFarm) -> TrialWhy:
    """What is known of why a trial failed; groups for users, effects and values for operators."""
    row = await _trial(farm, job_id, ordinal, caller)
    async with farm.database.read() as connection:
        return await whys.show(connection, row, _budget(farm), as_operator=caller.may(Scope.OPERATE))


async def sentence_of(shown: Trial, caller: Caller, farm: Farm) -> str | None:
    """The answer about a trial in one line, as its page shows it; None while there is none that the caller may see."""
    try:
        return (await get_why(shown.job_id, shown.ordinal, caller, farm)).sentence
    except NotFound:
        return None


def _budget(farm: Farm) -> whys.Budget:
    return whys.Budget(farm.settings.whys_per_robot)


async def _trial(farm: Farm, job_id: str, ordinal: int, caller: Caller) -> AnyRow:
    async with farm.database.read() as connection:
        owner_job = await views.job_row(connection, job_id, caller.sees_only)
        row = await trial_at(connection, owner_job.number, ordinal)
    if row is None:
        raise NotFound("trial-not-found", f"Job {job_id} has no trial {ordinal}; its last is {owner_job.trials - 1}.")
    return row
