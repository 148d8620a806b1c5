"""Routes of the farm's word: its public key, and the signature of a report."""

import json

from fastapi import APIRouter

from api_schemas.signature import PublicKey, Signature
from services.api.access import AnyCaller, User
from services.api.document import refusals
from services.api.farm import Farm, TheFarm
from services.api.jobs import JobId, stored_report
from services.jobs import reports

router = APIRouter(prefix="/v1", tags=["jobs"])


@router.get("/key")
async def get_key(_caller: AnyCaller, farm: TheFarm) -> PublicKey:
    """The key by which the farm's signatures are checked."""
    return PublicKey(key=farm.key.public_hex)


@router.get("/jobs/{job_id}/report/signature", responses=refusals(409))
async def get_signature(job_id: JobId, caller: User, farm: TheFarm) -> Signature:
    """The signature of a job's report; the same at every time."""
    body, _ = await stored_report(job_id, caller, farm)
    return sign(body, farm)


def sign(body: bytes, farm: Farm) -> Signature:
    """The farm's word for a stored report."""
    return reports.sign(json.loads(body), farm.key)
