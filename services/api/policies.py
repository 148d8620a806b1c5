"""Routes of policies: upload, list, get, and the converted graph for robots."""

import asyncio
import hashlib
import shutil
import tempfile
from pathlib import Path
from typing import Annotated, BinaryIO, Literal

import structlog
from fastapi import APIRouter, Depends, Request, Response
from fastapi import Path as InPath
from pydantic import ValidationError
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.types import Message, Receive

from api_schemas.policy import Policy, PolicyManifest, PolicyPage, policy_digest
from services.api.access import Operator, RobotCaller, Submitter, User
from services.api.at_once import one_more
from services.api.bodies import BodyRefused
from services.api.document import files, refusals
from services.api.farm import Farm, TheFarm
from services.api.paging import encode, numbered
from services.api.serving import stored_file
from services.database.pages import Asked
from services.errors import Refused, TooLarge, TooMany
from services.jobs import completion, lease
from services.policies.intake import weights_format
from services.policies.keeping import Upload
from services.tokens import Caller

log = structlog.get_logger()
router = APIRouter(prefix="/v1/policies", tags=["policies"])
Digest = Annotated[str, InPath(pattern=r"^[0-9a-f]{64}$")]
BuiltinName = Literal["grasp", "grasp-turn"]
GRAPH = "application/octet-stream"
MANIFEST_BYTES = 256 * 1024
FORM_BYTES = MANIFEST_BYTES + 64 * 1024
"""What a form may hold beside the weights."""
READ_BYTES = 1024 * 1024
MOST_UPLOADS = 2
"""Of one owner at the same time: one is converted while the next comes in."""
RETRY_AFTER_S = 2
_BODY = {
    "type": "object",
    "required": ["weights", "manifest"],
    "properties": {
        "weights": {"type": "string", "format": "binary", "description": "a .safetensors, .onnx or stable-baselines3 .zip file"},
        "manifest": {"type": "string", "description": "JSON text of a PolicyManifest"},
    },
}


_FORM = {"requestBody": {"required": True, "content": {"multipart/form-data": {"schema": _BODY}}}}


@router.put("/{digest}", response_model=Policy, responses={201: {"model": Policy}}, openapi_extra=_FORM)
async def put_policy(digest: Digest, request: Request, response: Response, caller: Submitter, farm: TheFarm) -> Policy:
    """Takes weights and a manifest; converts and tries them before it answers."""
    return await _take(digest, request, response, caller, farm)


@router.post(
    "",
    response_model=Policy,
    status_code=201,
    responses={200: {"model": Policy}, **refusals(422)},
    openapi_extra=_FORM,
)
async def post_policy(request: Request, response: Response, caller: Submitter, farm: TheFarm) -> Policy:
    """Takes weights and a manifest as PUT does, without their digest, which the answer has."""
    return await _take(None, request, response, caller, farm)


async def _take(address: str | None, request: Request, response: Response, caller: Caller, farm: Farm) -> Policy:
    farm.disk.check()
    detail = f"{caller.owner} has {MOST_UPLOADS} uploads under way, the limit for a user; wait for one to end."
    refusal = TooMany("too-many-uploads", detail, RETRY_AFTER_S)
    under_way = one_more(request.app.state.uploads, caller, MOST_UPLOADS, refusal)
    with under_way, tempfile.TemporaryDirectory(prefix="trifarm-upload-") as folder:
        upload = await _upload(address, request, Path(folder), caller, farm)
        policy, new = await farm.policies.take(upload, farm.clock.now_iso())
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/v1/policies/{policy.digest}"
    return policy


async def _upload(address: str | None, request: Request, folder: Path, caller: Caller, farm: Farm) -> Upload:
    """Reads the form, and puts its weights into ``folder``."""
    limited = Request(request.scope, _limited(request, farm.settings.max_weights_bytes))
    try:
        async with limited.form(max_files=1, max_fields=1, max_part_size=MANIFEST_BYTES) as form:
            weights, text = form.get("weights"), form.get("manifest")
            if not isinstance(weights, UploadFile) or not isinstance(text, str):
                raise Refused("form-incomplete", "Send multipart/form-data with a file 'weights' and a text 'manifest'.")
            kind = weights_format(weights.filename)
            manifest = _manifest(text)
            path = folder / f"weights.{kind}"
            sha256 = await asyncio.to_thread(_copy, weights.file, path)
    except BodyRefused:
        raise
    except HTTPException as error:
        raise Refused("form-malformed", f"The form cannot be read: {error.detail}") from error
    digest = policy_digest(sha256, manifest)
    share_bytes = None if caller.sees_only is None else farm.settings.max_policy_bytes_per_user
    return Upload(digest, path, sha256, kind, manifest, caller.owner, weights.filename, address, share_bytes)


def _limited(request: Request, limit_bytes: int) -> Receive:
    """Reads the request, and stops it at the limit before the form's parser has stored more."""
    left = limit_bytes + FORM_BYTES
    refusal = TooLarge("weights-too-large", f"The upload is larger than the {limit_bytes} bytes of weights that are taken.")
    announced = request.headers.get("content-length", "")
    if announced.isascii() and announced.isdigit() and int(announced) > left:
        raise refusal

    async def receive() -> Message:
        nonlocal left
        message = await request.receive()
        left -= len(message.get("body", b""))
        if left < 0:
            raise refusal
        return message

    return receive


def _copy(source: BinaryIO, path: Path) -> str:
    with path.open("xb+") as file:
        shutil.copyfileobj(source, file, READ_BYTES)
        file.seek(0)
        return hashlib.file_digest(file, "sha256").hexdigest()


def _manifest(text: str) -> PolicyManifest:
    try:
        return PolicyManifest.model_validate_json(text)
    except ValidationError as error:
        found = [{"where": ".".join(str(part) for part in each["loc"]), "message": each["msg"]} for each in error.errors()]
        detail = "; ".join(f"{each['where']}: {each['message']}" for each in found)
        raise Refused("manifest-invalid", f"The manifest is not valid: {detail}", errors=found) from error


@router.put("/builtin/{name}", response_model=Policy, responses={201: {"model": Policy}})
async def put_builtin(name: BuiltinName, response: Response, caller: Operator, farm: TheFarm) -> Policy:
    """Makes a policy that comes with the farm the operator's, so that jobs of it can be queued."""
    policy, new = await farm.policies.take_builtin(name, caller.owner, farm.clock.now_iso())
    response.status_code = 201 if new else 200
    return policy


@router.get("")
async def list_policies(
    caller: User, farm: TheFarm, asked: Annotated[Asked, Depends(numbered(usual=50, most=200))]
) -> PolicyPage:
    """Policies, newest first; users see their own, operators all."""
    page = await farm.policies.page(caller.sees_only, asked)
    return PolicyPage(policies=tuple(page.entries), next_cursor=encode(page.following))


@router.get("/{digest}")
async def get_policy(digest: Digest, caller: User, farm: TheFarm) -> Policy:
    """One policy."""
    return await farm.policies.find(digest, caller.sees_only)


@router.delete("/{digest}", status_code=204, responses=refusals(404, 409))
async def delete_policy(digest: Digest, caller: Submitter, farm: TheFarm) -> None:
    """Deletes a policy of one's own that no job refers to."""
    await farm.policies.disown(digest, caller.owner)


@router.get("/{digest}/graph", response_class=Response, responses=files(GRAPH))
async def get_graph(digest: Digest, request: Request, caller: RobotCaller, farm: TheFarm) -> Response:
    """The converted graph, for a robot that holds a lease of the policy."""
    async with farm.database.read() as connection:
        await lease.check_policy_leased(connection, digest, caller.robot)
    policy = await farm.policies.find(digest)
    if caller.robot is not None and await farm.files.find(policy.graph_sha256) is None:
        await _break_off_jobs(policy, farm)
    return await stored_file(request, farm.files, policy.graph_sha256, GRAPH, f"{digest}.onnx")


async def _break_off_jobs(policy: Policy, farm: Farm) -> None:
    """Fails the jobs of a policy whose graph is gone.

    No robot can run them. Each that tried would be blamed for a lease that it could not use, until all are out of service.
    """
    async with farm.database.read() as connection:
        numbers = await completion.unended_of(connection, policy.digest)
    hint = "once the policy has been uploaded again, an operator can queue the job again"
    reason = f"the file of policy {policy.name}'s graph is gone from the farm; {hint}"
    for number in numbers:
        async with farm.database.write() as tx:
            job_id = await completion.break_off(tx, farm.clock.now_s(), number, reason)
        if job_id is not None:
            log.error("job failed, its policy's graph is gone", job=job_id, digest=policy.digest, graph=policy.graph_sha256)
            farm.signals.job_changed(job_id)
    farm.signals.wake_dispatcher(urgent=True)
