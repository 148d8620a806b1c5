"""Routes of what only the simulation knows of a trial: operators fetch it, owners have their logs compared with it."""

import asyncio
import tempfile
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Request, Response
from fastapi import Path as InPath

from api_schemas.job import MAX_TRIALS
from api_schemas.token import Scope
from api_schemas.trial import Verification
from jail.level import too_open
from services.api.access import Operator, User
from services.api.at_once import one_more
from services.api.document import BINARY, files, refusals
from services.api.farm import Farm, TheFarm
from services.api.jobs import JobId
from services.api.serving import stored_file, stored_size
from services.api.trials import MCAP
from services.database.rows import AnyRow
from services.errors import NotFound, Refused, TooLarge, TooMany, TooSlow, Unavailable
from services.jobs import views
from services.jobs.lists import trial_at
from services.tokens import Caller
from services.verification import replaying
from services.verification.replaying import Compared

router = APIRouter(prefix="/v1/jobs/{job_id}/trials/{ordinal}", tags=["trials"])
MCAP_MAGIC = b"\x89MCAP0\r\n"
"""How every MCAP file begins (mcap.dev/spec, "Magic")."""
SPARE_BYTES = 1024**2
"""What a log may be larger than twice the one that the farm keeps: packed in another way, it is still the same log."""
MOST_VERIFIED = 1
"""Logs of one owner at the same time, from the first byte that comes in to the verdict."""
RETRY_AFTER_S = 10
Ordinal = Annotated[int, InPath(ge=0, lt=MAX_TRIALS)]


@router.head("/truth", response_class=Response, responses=files(MCAP))
@router.get("/truth", response_class=Response, responses=files(MCAP))
async def get_truth(job_id: JobId, ordinal: Ordinal, request: Request, _caller: Operator, farm: TheFarm) -> Response:
    """The MCAP file with the trial's truth and its robot's physics; byte ranges are served."""
    row = await _with_truth(farm, job_id, ordinal, None)
    return await stored_file(request, farm.files, row.truth_sha256, MCAP, f"{row.trial_id}.truth.mcap")


@router.post(
    "/verify",
    responses=refusals(408),
    openapi_extra={"requestBody": {"required": True, "content": {"application/octet-stream": {"schema": BINARY}}}},
)
async def verify_log(job_id: JobId, ordinal: Ordinal, request: Request, caller: User, farm: TheFarm) -> Verification:
    """Simulates the trial again and compares the log in the body with that: the same numbers, or the first step that differs."""
    row = await _with_truth(farm, job_id, ordinal, caller.sees_only)
    if (reason := too_open(farm.jail, farm.settings.jail_level)) is not None:
        raise Unavailable("jail-too-open", f"The farm takes no logs now: {reason}. Its operator can change that.")
    for sha256 in (row.truth_sha256, row.log_sha256):
        await stored_size(farm.files, sha256)
    detail = f"A log of {caller.owner} is being verified, and a user may have one at a time; wait for its verdict."
    refusal = TooMany("too-many-verifications", detail, RETRY_AFTER_S)
    with one_more(request.app.state.verified, caller, MOST_VERIFIED, refusal):
        return shown_to(caller, await _verified(row, request, caller, farm))


async def _verified(row: AnyRow, request: Request, caller: Caller, farm: Farm) -> Verification:
    with tempfile.TemporaryDirectory(prefix="trifarm-verify-") as folder:
        files = Compared(*(Path(folder) / f"{name}.mcap" for name in ("log", "truth", "original")))
        await _receive(files.log, request, 2 * row.log_bytes + SPARE_BYTES, farm.settings.verification_upload_s)
        await asyncio.to_thread(_check_form, files.log)
        # Only now: slow senders hold up nobody else.
        async with farm.verifications:
            await _write(files.truth, farm.files.read(row.truth_sha256))
            await _write(files.original, farm.files.read(row.log_sha256))
            tell_all = caller.may(Scope.OPERATE)
            return await replaying.verify(files, farm.settings.verification_deadline_s, tell_all=tell_all)


def shown_to(caller: Caller, verdict: Verification) -> Verification:
    """The verdict; without the size of differences for those who may not know the robot's physics."""
    if caller.may(Scope.OPERATE):
        return verdict
    return verdict.model_copy(update={"largest_joint_difference_rad": None, "largest_cube_difference_m": None})


async def _with_truth(farm: Farm, job_id: str, ordinal: int, owner: str | None) -> AnyRow:
    async with farm.database.read() as connection:
        owner_job = await views.job_row(connection, job_id, owner)
        row = await trial_at(connection, owner_job.number, ordinal)
    if row is None:
        raise NotFound("trial-not-found", f"Job {job_id} has no trial {ordinal}; its last is {owner_job.trials - 1}.")
    if row.truth_sha256 is None or row.log_sha256 is None:
        detail = f"Trial {row.trial_id} is {row.state} and has no truth apart from its log; a nominal farm's log holds it all."
        raise NotFound("truth-not-found", detail)
    return row


async def _receive(path: Path, request: Request, limit_bytes: int, within_s: float) -> None:
    """The body of the request, as far as it comes in time and is not larger than such a log can be."""
    size = 0
    try:
        async with asyncio.timeout(within_s):
            with path.open("xb") as file:
                async for chunk in request.stream():
                    size += len(chunk)
                    if size > limit_bytes:
                        raise TooLarge("file-too-large", f"The file is larger than the {limit_bytes} bytes that are taken.")
                    await asyncio.to_thread(file.write, chunk)
    except TimeoutError as error:
        raise TooSlow("body-too-slow", f"The file did not arrive within {within_s:g} s; {size} bytes of it did.") from error


def _check_form(path: Path) -> None:
    """Refuses what is plainly no log before a process is started to read it."""
    with path.open("rb") as file:
        start = file.read(len(MCAP_MAGIC))
    if start != MCAP_MAGIC:
        detail = f"The file begins with {start!r} and is no MCAP file; send a log that 'trifarm fetch' brought."
        raise Refused("log-unfit", detail)


async def _write(path: Path, chunks: AsyncIterator[bytes]) -> None:
    with path.open("xb") as file:
        async for chunk in chunks:
            await asyncio.to_thread(file.write, chunk)
