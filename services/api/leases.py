"""Routes of robots that hold a lease: renew it, upload the log, report the outcome last."""

from typing import Annotated

from fastapi import APIRouter, BackgroundTasks, Header, Path, Request

from api_schemas.robot import MAX_FENCE, OutcomeReply, OutcomeReport, Renewal, RenewalReply, StoredFile
from services.api.access import RobotCaller
from services.api.document import BINARY, refusals
from services.api.farm import Farm, TheFarm
from services.api.trials import TrialId
from services.errors import Forbidden, Refused
from services.jobs import completion, lease
from services.jobs.claim import Claim
from services.jobs.holding import Reported, Uploaded
from services.tokens import Caller

router = APIRouter(prefix="/v1/leases", tags=["leases"])
FILE = {"requestBody": {"required": True, "content": {"application/octet-stream": {"schema": BINARY}}}}
Fence = Annotated[int, Path(ge=1, le=MAX_FENCE)]
AnnouncedSha256 = Annotated[str | None, Header(alias="X-Content-SHA256", pattern=r"^[0-9a-f]{64}$")]


@router.post("/{trial_id}/renew", responses=refusals(409))
async def renew_lease(trial_id: TrialId, body: Renewal, caller: RobotCaller, farm: TheFarm) -> RenewalReply:
    """Prolongs a lease."""
    _check_robot(caller, body.robot)
    cancel = await farm.holding.renew(trial_id, body)
    farm.fleet.renewed(Claim(trial_id, body.fence, body.robot), farm.clock.now_s())
    return RenewalReply(lease_s=farm.settings.lease_s, cancel=cancel)


@router.put("/{trial_id}/{fence}/log", responses=refusals(409), openapi_extra=FILE)
async def put_log(
    trial_id: TrialId,
    fence: Fence,
    request: Request,
    caller: RobotCaller,
    farm: TheFarm,
    x_content_sha256: AnnouncedSha256 = None,
) -> StoredFile:
    """Takes a log under a lease that holds; it is kept under its SHA-256, which the outcome then names."""
    return await _keep(farm, trial_id, fence, "log", request, caller, x_content_sha256)


@router.put("/{trial_id}/{fence}/truth", responses=refusals(409), openapi_extra=FILE)
async def put_truth(
    trial_id: TrialId,
    fence: Fence,
    request: Request,
    caller: RobotCaller,
    farm: TheFarm,
    x_content_sha256: AnnouncedSha256 = None,
) -> StoredFile:
    """Takes what only the simulation knows of a trial, as ``log`` takes the log; operators alone can fetch it."""
    return await _keep(farm, trial_id, fence, "truth", request, caller, x_content_sha256)


def _check_robot(caller: Caller, robot: str) -> None:
    """A robot speaks for itself alone."""
    if caller.robot not in (None, robot):
        raise Forbidden(
            "token-of-another-robot", f"The token is of {caller.robot} and the body speaks for {robot}; send your own."
        )


async def _keep(
    farm: Farm, trial_id: str, fence: int, kind: lease.FileKind, request: Request, caller: Caller, announced: str | None
) -> StoredFile:
    async with farm.database.read() as connection:
        await lease.check_lease(connection, trial_id, fence, caller.robot)
    limit_bytes = farm.settings.max_log_bytes
    stored = await farm.files.put(request.stream(), limit_bytes=limit_bytes, expected_sha256=announced)
    await farm.holding.keep_file(Uploaded(trial_id, fence, kind, stored.sha256))
    return StoredFile(sha256=stored.sha256, bytes=stored.size, new=stored.new)


@router.post("/{trial_id}/outcome", responses=refusals(409))
async def post_outcome(
    trial_id: TrialId, body: OutcomeReport, after: BackgroundTasks, caller: RobotCaller, farm: TheFarm
) -> OutcomeReply:
    """Takes the outcome of an attempt; the same one again is taken again and changes nothing."""
    _check_robot(caller, body.robot)
    log_bytes = None if body.log_sha256 is None else await farm.files.size(body.log_sha256)
    if body.log_sha256 is not None and log_bytes is None:
        raise Refused("log-missing", f"No log {body.log_sha256} was uploaded; PUT /v1/leases/{trial_id}/{body.fence}/log first.")
    ending = await farm.holding.accept(Reported(trial_id, body, log_bytes))
    if ending.job_id is not None:
        farm.signals.job_changed(ending.job_id)
        # After the answer is sent, so that the robot has it before the next offer reaches it.
        after.add_task(_robot_is_free, farm, Claim(trial_id, body.fence, body.robot), ending)
    return OutcomeReply()


async def _robot_is_free(farm: Farm, claim: Claim, ending: completion.Ending) -> None:
    farm.fleet.freed(claim, done=ending.done)
    farm.signals.wake_dispatcher(urgent=ending.job_ended)
