"""Routes of what only the simulation knows of a trial: operators fetch it, owners have their logs compared with it."""

import asyncio
import tempfile
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Request, Response
from fastapi import Path as InPath
from sqlalchemy import select

from api_schemas.token import Scope
from api_schemas.verification import Verification
from services.api.access import Operator, User
from services.api.farm import Farm, TheFarm
from services.api.jobs import JobId
from services.api.serving import stored_file
from services.api.tokens import Caller
from services.api.trials import MCAP
from services.database.rows import AnyRow
from services.database.tables import trial
from services.errors import NotFound, TooLarge
from services.jobs import views
from services.verification import replaying

router = APIRouter(prefix="/v1/jobs/{job_id}/trials/{ordinal}", tags=["trials"])
Ordinal = Annotated[int, InPath(ge=0, le=9999)]


@router.api_route("/truth", methods=["GET", "HEAD"], response_class=Response)
async def get_truth(job_id: JobId, ordinal: Ordinal, request: Request, _caller: Operator, farm: TheFarm) -> Response:
    """The MCAP file with the trial's truth and its robot's physics; byte ranges are served."""
    row = await _with_truth(farm, job_id, ordinal, None)
    return await stored_file(request, farm.files, row.truth_sha256, MCAP, f"{row.trial_id}.truth.mcap")


@router.post(
    "/verify",
    openapi_extra={"requestBody": {"required": True, "content": {MCAP: {"schema": {"type": "string", "format": "binary"}}}}},
)
async def verify_log(job_id: JobId, ordinal: Ordinal, request: Request, caller: User, farm: TheFarm) -> Verification:
    """Simulates the log in the body again on the robot of this trial: the same numbers, or the first step that differs."""
    row = await _with_truth(farm, job_id, ordinal, caller.sees_only)
    async with farm.verifications:
        with tempfile.TemporaryDirectory(prefix="trifarm-verify-") as folder:
            log, truth = Path(folder) / "log.mcap", Path(folder) / "truth.mcap"
            await _write(log, request.stream(), farm.settings.max_log_bytes)
            await _write(truth, farm.files.read(row.truth_sha256), farm.settings.max_log_bytes)
            verdict = await replaying.verify(log, truth, farm.settings.verification_deadline_s)
    return shown_to(caller, verdict)


def shown_to(caller: Caller, verdict: Verification) -> Verification:
    """The verdict; without the size of differences for those who may not know the robot's physics."""
    if caller.may(Scope.OPERATE):
        return verdict
    return verdict.model_copy(update={"largest_joint_difference_rad": None, "largest_cube_difference_m": None})


async def _with_truth(farm: Farm, job_id: str, ordinal: int, owner: str | None) -> AnyRow:
    async with farm.database.read() as connection:
        owner_job = await views.job_row(connection, job_id, owner)
        wanted = select(trial).where(trial.c.job_number == owner_job.number, trial.c.ordinal == ordinal)
        row = (await connection.execute(wanted)).one_or_none()
    if row is None:
        raise NotFound("trial-not-found", f"Job {job_id} has no trial {ordinal}; its last is {owner_job.trials - 1}.")
    if row.truth_sha256 is None:
        detail = f"Trial {row.trial_id} is {row.state} and has no truth apart from its log; a nominal farm's log holds it all."
        raise NotFound("truth-not-found", detail)
    return row


async def _write(path: Path, chunks: AsyncIterator[bytes], limit_bytes: int) -> None:
    size = 0
    with path.open("xb") as file:
        async for chunk in chunks:
            size += len(chunk)
            if size > limit_bytes:
                raise TooLarge("file-too-large", f"The file is larger than the {limit_bytes} bytes that are taken.")
            await asyncio.to_thread(file.write, chunk)
