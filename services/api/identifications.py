"""The route that asks for an identification: excitations on one robot, recorded like trials."""

from fastapi import APIRouter, Response

from api_schemas.excitation import IdentificationRequest
from api_schemas.job import Job
from services.api.access import Submitter
from services.api.document import refusals
from services.api.farm import TheFarm
from services.api.jobs import IdempotencyKey, sender_of, show_queued
from services.jobs import submission

router = APIRouter(prefix="/v1/identifications", tags=["jobs"])


@router.post("", response_model=Job, status_code=201, responses={200: {"model": Job}, **refusals(404, 409)})
async def create_identification(
    body: IdentificationRequest, response: Response, caller: Submitter, farm: TheFarm, idempotency_key: IdempotencyKey = None
) -> Job:
    """Queues an identification, which is a job of the task ``identify``; an Idempotency-Key works as for other jobs."""
    farm.disk.check()
    present = [member.robot for member in farm.fleet.members.values() if member.heartbeat is not None]
    async with farm.database.write() as tx:
        sender = sender_of(caller, farm, idempotency_key)
        job_id, new = await submission.identify(tx, farm.clock.now_s(), body, sender, present)
    return await show_queued(job_id, new, response, caller, farm)
