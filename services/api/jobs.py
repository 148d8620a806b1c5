"""Routes of jobs: create, list, get, cancel, and their reports."""

from typing import Annotated

from fastapi import APIRouter, Depends, Header, Path, Query, Request, Response
from fastapi.responses import PlainTextResponse

from api_schemas.goal import JobGoals
from api_schemas.job import Job, JobLabels, JobPage, JobPriority, JobRequest, JobState, JobWebhook
from api_schemas.report import AnyReport, read_report
from api_schemas.token import Scope
from api_schemas.webhook import Webhook
from report_views.text import render
from services.api.access import Operator, Submitter, User
from services.api.document import refusals
from services.api.farm import Farm, TheFarm
from services.api.paging import by_trial, encode, numbered
from services.database.pages import Asked
from services.errors import Conflict, Forbidden, Refused
from services.jobs import cancellation, labels, reports, requeue, submission, views
from services.jobs.lists import JobFilter, job_page, trial_page
from services.tokens import Caller
from services.webhooks import delivery

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])
JobId = Annotated[str, Path(pattern=r"^[a-z0-9]{1,20}$")]
NO_NUL = r"^[^\x00]*$"
"""A text without the character that PostgreSQL does not take."""
Search = Annotated[str, Query(max_length=100, pattern=NO_NUL)]
IdempotencyKey = Annotated[str | None, Header(alias="Idempotency-Key", min_length=1, max_length=200)]


@router.post("", response_model=Job, status_code=201, responses={200: {"model": Job}, **refusals(404, 409)})
async def create_job(
    body: JobRequest, response: Response, caller: Submitter, farm: TheFarm, idempotency_key: IdempotencyKey = None
) -> Job:
    """Queues a job; with an Idempotency-Key the same request twice is one job."""
    if body.webhook is not None and not farm.settings.webhooks:
        raise _webhooks_off()
    check_priority(caller, body.priority)
    farm.disk.check()
    async with farm.database.write() as tx:
        now_s = farm.clock.now_s()
        job_id, new = await submission.submit(
            tx,
            now_s,
            body,
            sender_of(caller, farm, idempotency_key),
            page=farm.settings.trials_page,
            blind=farm.fleet.is_blind(now_s),
        )
        if new and body.webhook is not None:
            await delivery.register(tx, job_id, body.webhook)
    return await show_queued(job_id, new, response, caller, farm)


@router.get("")
async def list_jobs(
    caller: User,
    farm: TheFarm,
    asked: Annotated[Asked, Depends(numbered(usual=50, most=200))],
    state: JobState | None = None,
    q: Search = "",
) -> JobPage:
    """Jobs, newest first, with the text ``q`` in a name, a note or an id; users see their own, operators all."""
    async with farm.database.read() as connection:
        page = await job_page(connection, JobFilter(caller.sees_only, state, q.strip()), asked)
        limit = farm.settings.user_trials_at_once
        shown = await views.show_jobs(connection, page.entries, farm.fleet, farm.clock.now_s(), limit)
    return JobPage(jobs=shown, next_cursor=encode(page.following))


@router.get("/{job_id}")
async def get_job(job_id: JobId, caller: User, farm: TheFarm) -> Job:
    """One job, and why it is not over yet."""
    return await _show(job_id, caller, farm)


@router.post("/{job_id}/cancel", responses=refusals(409))
async def cancel_job(job_id: JobId, caller: User, farm: TheFarm) -> Job:
    """Takes queued trials out of the queue and has running ones stopped; the job ends when they have."""
    async with farm.database.write() as tx:
        row = await views.job_row(tx, job_id, caller.sees_only)
        await cancellation.cancel(tx, farm.clock.now_s(), row.number)
    farm.signals.job_changed(job_id)
    farm.signals.wake_dispatcher(urgent=True)
    return await _show(job_id, caller, farm)


@router.patch("/{job_id}")
async def label_job(job_id: JobId, body: JobLabels, caller: User, farm: TheFarm) -> Job:
    """Names the job, or notes something about it; what is not given stays."""
    async with farm.database.write() as tx:
        row = await views.job_row(tx, job_id, caller.sees_only)
        await labels.label(tx, row.number, body.model_dump(include=body.model_fields_set))
    return await _show(job_id, caller, farm)


@router.get("/{job_id}/goals", responses=refusals(409))
async def get_goals(job_id: JobId, caller: User, farm: TheFarm, asked: Annotated[Asked, Depends(by_trial)]) -> JobGoals:
    """The goals of a job's trials, and where its object begins."""
    async with farm.database.read() as connection:
        row = await views.job_row(connection, job_id, caller.sees_only)
        if row.policy is None:
            raise Conflict("no-goals", f"Job {job_id} is an identification, whose excitations have no goals.")
        page = await trial_page(connection, row.number, asked)
    goals = await farm.goals.of_job(row, page.entries, caller.owner)
    return goals.model_copy(update={"next_cursor": encode(page.following)})


@router.get("/{job_id}/webhook")
async def get_webhook(job_id: JobId, caller: User, farm: TheFarm) -> Webhook:
    """The job's webhook, and what came of calling it."""
    async with farm.database.read() as connection:
        return await delivery.show(connection, await views.job_row(connection, job_id, caller.sees_only))


@router.put("/{job_id}/webhook", responses=refusals(404, 409))
async def set_webhook(job_id: JobId, body: JobWebhook, caller: User, farm: TheFarm) -> Webhook:
    """Has an address called when the job ends, where the farm allows it and none is called yet."""
    if not farm.settings.webhooks:
        raise _webhooks_off()
    async with farm.database.write() as tx:
        row = await views.job_row(tx, job_id, caller.sees_only)
        await delivery.add(tx, row, body.url)
        return await delivery.show(tx, row)


def _webhooks_off() -> Refused:
    return Refused("webhooks-off", "This farm calls no webhooks; its operator can allow them with TRIFARM_WEBHOOKS=true.")


@router.post("/{job_id}/requeue", responses=refusals(409))
async def requeue_job(job_id: JobId, caller: Operator, farm: TheFarm) -> Job:
    """Puts a failed job back into the queue; what it has done is kept, and the rest is tried anew."""
    async with farm.database.read() as connection:
        row = await views.job_row(connection, job_id, caller.sees_only)
    await requeue.check_logs(farm.database, farm.files, row.number)
    async with farm.database.write() as tx:
        await requeue.requeue(tx, farm.clock.now_s(), row.number)
    farm.signals.job_changed(job_id)
    farm.signals.wake_dispatcher(urgent=True)
    return await _show(job_id, caller, farm)


def check_priority(caller: Caller, asked: JobPriority) -> None:
    """Raises where a user would go before the others."""
    if asked is JobPriority.HIGH and not caller.may(Scope.OPERATE):
        detail = f"Only operators queue jobs of priority high; {caller.owner} can ask for normal or low."
        raise Forbidden("priority-too-high", detail)


def sender_of(caller: Caller, farm: Farm, idempotency_key: str | None) -> submission.Sender:
    """Who sends a job: users with their own policies and within their share of the queue, operators with everything."""
    if caller.sees_only is None:
        return submission.Sender(caller.owner, idempotency_key)
    told = farm.settings
    bounds = (told.max_queued_jobs_per_user, told.max_queued_trials_per_user, told.max_trials_per_job)
    return submission.Sender(caller.owner, idempotency_key, caller.sees_only, *bounds)


async def show_queued(job_id: str, new: bool, response: Response, caller: Caller, farm: Farm) -> Job:
    """The answer to whoever sent a job: 201 and where it is, or 200 when it had been sent before."""
    farm.signals.wake_dispatcher()
    farm.signals.tell_others(job_id)
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/v1/jobs/{job_id}"
    return await _show(job_id, caller, farm)


@router.get("/{job_id}/report", response_model=AnyReport, responses={304: {"description": "As known"}, **refusals(409)})
async def get_report(job_id: JobId, request: Request, caller: User, farm: TheFarm) -> Response:
    """The report, byte for byte as it was written at the job's end."""
    body, sha256 = await stored_report(job_id, caller, farm)
    tag = f'"{sha256}"'
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers={"ETag": tag})
    return Response(body, media_type="application/json", headers={"ETag": tag})


@router.get("/{job_id}/report/text", response_class=PlainTextResponse, responses=refusals(409))
async def get_report_text(job_id: JobId, caller: User, farm: TheFarm) -> str:
    """The report for people."""
    body, _ = await stored_report(job_id, caller, farm)
    return render(read_report(body))


async def stored_report(job_id: str, caller: Caller, farm: Farm) -> tuple[bytes, str]:
    """The report of a job that the caller may see, as it was written, and its SHA-256."""
    limit = farm.settings.user_trials_at_once
    return await reports.stored(farm.database, farm.fleet, farm.clock.now_s(), job_id, caller.sees_only, limit)


async def _show(job_id: str, caller: Caller, farm: Farm) -> Job:
    async with farm.database.read() as connection:
        row = await views.job_row(connection, job_id, caller.sees_only)
        (shown,) = await views.show_jobs(connection, [row], farm.fleet, farm.clock.now_s(), farm.settings.user_trials_at_once)
        return await views.show_question(connection, row, shown)
