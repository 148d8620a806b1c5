"""The page of one job: how far it is, its success rate so far, its robots, and its trials, failures first."""

from collections import defaultdict
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import takewhile
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Form, Query, Response
from fastapi.responses import HTMLResponse, JSONResponse, RedirectResponse
from fastapi.sse import EventSourceResponse, ServerSentEvent

from api_schemas.job import (
    FINAL_JOB_STATES,
    LONGEST_NAME,
    LONGEST_NOTE,
    MAX_CHOSEN,
    MAX_TRIALS,
    Job,
    JobLabels,
    JobState,
    JobWebhook,
    TaskName,
    WebhookUrl,
)
from api_schemas.report import Report, read_report
from api_schemas.token import Scope
from api_schemas.tolerance import ANGLE_TOLERANCE_RAD, POSITION_TOLERANCE_M
from api_schemas.trial import Outcome, OutcomeKind, TrialState
from report_views.page import render_page, style_source
from services.api import jobs, signatures
from services.api.farm import Farm, TheFarm
from services.api.jobs import JobId, stored_report
from services.api.trials import trials_as_csv
from services.dashboard import figures, live, sheet
from services.dashboard.pages import HEADERS, PageRoute, page, part
from services.dashboard.sessions import Changing, Operating, Session, SignedIn
from services.database.rows import AnyRow
from services.errors import NotFound
from services.jobs import views
from services.jobs.clock import iso
from services.jobs.lists import platform_faults, some_trials, trials_of
from services.tokens import Caller
from services.webhooks import delivery

router = APIRouter(route_class=PageRoute, include_in_schema=False)
ON_A_PAGE = 100
FAILED_BY_PLATFORM = "failed_by_platform"
Order = Literal["failures", "trial", "robot", "error"]


@dataclass(frozen=True)
class TrialLine:
    """One trial in the table."""

    row: AnyRow
    outcome: Outcome | None

    @property
    def rank(self) -> int:
        """Failures first, then what runs, then successes, then what waits."""
        if self.outcome is None:
            return {FAILED_BY_PLATFORM: 0, "running": 2, "leased": 2, "queued": 4}.get(self.shown, 5)
        if self.outcome.kind in {OutcomeKind.SUCCEEDED, OutcomeKind.RECORDED}:
            return 3
        return 0 if self.outcome.fault != "none" else 1

    @property
    def waits(self) -> bool:
        """Whether nothing has happened to it yet, and never will where its job is over."""
        return self.row.state in {TrialState.QUEUED, TrialState.HELD, TrialState.CANCELLED} and self.row.fence == 0

    @property
    def shown(self) -> str:
        """How it ended, or its state; a trial whose platform errors ended the job did so, though it came back to the queue."""
        if self.outcome is not None:
            return str(self.outcome.kind)
        return FAILED_BY_PLATFORM if self.row.state == TrialState.CANCELLED and self.row.faults else self.row.state

    @property
    def error_m(self) -> float:
        """How far from the goal it ended; infinitely far where that was not measured."""
        measures = None if self.outcome is None else self.outcome.measures
        return float("inf") if measures is None else measures.final_position_error_m

    @property
    def angle_error_rad(self) -> float | None:
        """How far from the goal's orientation it ended; None where that was not measured or does not count."""
        measures = None if self.outcome is None else self.outcome.measures
        return None if measures is None else measures.final_angle_error_rad


def ended_of(lines: Sequence[TrialLine]) -> list[tuple[AnyRow, Outcome]]:
    """The trials that are done, in their order, with their outcomes."""
    return [(line.row, line.outcome) for line in lines if line.row.state == TrialState.DONE and line.outcome is not None]


@dataclass(frozen=True)
class Wanted:
    """How the table of trials is to be."""

    order: Order
    first: int


async def _wanted(order: Order = "failures", first: Annotated[int, Query(ge=0, le=MAX_TRIALS)] = 0) -> Wanted:
    return Wanted(order, first)


TheWanted = Annotated[Wanted, Depends(_wanted)]


async def parts(session: Session, farm: Farm, job_id: str, wanted: Wanted) -> dict[str, str]:
    """The parts of the page.

    Raises:
        NotFound: there is no such job, or it is another's.
    """
    async with farm.database.read() as connection:
        row = await views.job_row(connection, job_id, session.caller.sees_only)
        (job,) = await views.show_jobs(connection, [row], farm.fleet, farm.clock.now_s(), farm.settings.user_trials_at_once)
        trials = [_line(each) for each in await trials_of(connection, row.number)]
        job = await views.show_question(connection, row, job)
        steps = in_order(trials)
        in_part = job.trials > MAX_CHOSEN
        by_number = in_part and wanted.order == "trial"
        page_of = await some_trials(connection, row.number, wanted.first - 1, ON_A_PAGE + 1) if by_number else []
        faults = await platform_faults(connection, row.number) if job.state == JobState.FAILED else []
        told = await delivery.known(connection, row)
    judged = job.task is not TaskName.IDENTIFY
    ended, (counted, succeeded) = job.state in FINAL_JOB_STATES, steps[-1] if steps else (0, 0)
    if ended and not row.judged:
        counted, succeeded = job.trials_done, job.successes
    elif row.counted_trials is not None:
        counted, succeeded = row.counted_trials, row.counted_successes
    left_s = None if ended or not job.started_at else time_left_s(job, lasted_s(job.started_at, iso(farm.clock.now_s())))
    bar = figures.Bar.of("all", succeeded, counted, at_every_look=row.judged or not ended)
    head: dict[str, Any] = {
        "csrf": session.csrf,
        "ended": job.state in FINAL_JOB_STATES,
        "operates": session.caller.may(Scope.OPERATE),
    }
    head["shares"] = farm.settings.shares
    head["took_s"] = None if not (job.started_at and job.ended_at) else lasted_s(job.started_at, job.ended_at)
    part_of = {"looked_at": MAX_CHOSEN if in_part else None}
    made = {"head": part("job/head.html", job=job, **head)}
    made["progress"] = part(
        "job/progress.html", job=job, bar=bar, judged=judged, at_every_look=row.judged or not ended, left_s=left_s, **part_of
    )
    if judged:
        made |= _figures(job, trials, steps)
    if job.state == JobState.FAILED:
        made["faults"] = part("job/faults.html", faults=faults)
    notice = {"webhook": told, "allowed": farm.settings.webhooks, "csrf": session.csrf, "ended": head["ended"]}
    made["notice"] = part("job/notice.html", job=job, **notice)
    lines = _ordered(trials, wanted.order)
    waiting = 0
    if wanted.order == "failures":
        waiting = 0 if in_part else sum(line.waits for line in lines)
        lines = [line for line in lines if not line.waits]
    angles = any(line.angle_error_rad is not None for line in trials)
    if by_number:
        shown = [_line(each) for each in page_of[:ON_A_PAGE]]
        more = wanted.first + ON_A_PAGE if len(page_of) > ON_A_PAGE else None
    else:
        shown = lines[wanted.first : wanted.first + ON_A_PAGE]
        more = wanted.first + ON_A_PAGE if wanted.first + ON_A_PAGE < len(lines) else None
    last = {row.trial_id: row for row in faults}  # those of a trial stand in their order
    told = {
        "reasons": {name: row.reason for name, row in last.items()},
        "tried_on": {name: row.robot for name, row in last.items()},
    }
    listed = {"lines": shown, "wanted": wanted, "more": more, "waiting": waiting, "angles": angles}
    made["trials"] = part("job/trials.html", job=job, **listed, **told)
    return made


def lasted_s(start: str, end: str) -> float:
    """Seconds between two moments."""
    return (datetime.fromisoformat(end) - datetime.fromisoformat(start)).total_seconds()


def time_left_s(job: Job, lasted_s: float) -> float | None:
    """About how long a job goes on at the pace that it had so far; None before its first trials are done."""
    left = job.trials - job.trials_done
    return lasted_s * left / job.trials_done if job.trials_done and left else None


def _figures(job: Job, trials: Sequence[TrialLine], steps: Sequence[tuple[int, int]]) -> dict[str, str]:
    of: dict[str, list[bool]] = defaultdict(list)
    for line in trials:
        if line.outcome is not None and line.row.robot is not None:
            of[line.row.robot].append(line.outcome.kind == OutcomeKind.SUCCEEDED)
    bars = [figures.Bar.of(robot, sum(done), len(done)) for robot, done in sorted(of.items())]
    measured = [line for line in trials if line.outcome is not None and line.outcome.measures is not None]
    errors = [(line.error_m, line.outcome.kind == OutcomeKind.SUCCEEDED) for line in measured if line.outcome]
    turns = [(line.angle_error_rad, line.outcome.kind == OutcomeKind.SUCCEEDED) for line in measured if line.outcome]
    turns = [(angle, done) for angle, done in turns if angle is not None]
    limits = {
        "ended": job.state in FINAL_JOB_STATES,
        "limit": figures.error_x(POSITION_TOLERANCE_M),
        "turn_limit": figures.angle_x(ANGLE_TOLERANCE_RAD),
    }
    done = ended_of(trials)
    over = {"ended": job.state in FINAL_JOB_STATES}
    most = min(job.trials, MAX_CHOSEN)
    return {
        "curve": part("job/curve.html", job=job, curve=figures.narrowing(steps, most), most=most, any=bool(steps), **over),
        "robots": part("job/robots.html", bars=bars, **over),
        "errors": part(
            "job/errors.html", dots=figures.dots(errors), ticks=figures.ticks(), turns=figures.turned(turns), **limits
        ),
        "sheet": part("job/sheet.html", groups=sheet.grouped(done), **over),
        "map": part("job/map.html", spots=sheet.spots(done), known=bool(done), **over),
    }


def in_order(trials: Sequence[TrialLine]) -> list[tuple[int, int]]:
    """Trials and successes after each of the first trials that are all done; which end first may depend on how they end."""
    steps, successes = [], 0
    for number, line in enumerate(takewhile(lambda line: line.row.state == TrialState.DONE, trials), start=1):
        successes += line.outcome is not None and line.outcome.kind == OutcomeKind.SUCCEEDED
        steps.append((number, successes))
    return steps


def _line(row: AnyRow) -> TrialLine:
    return TrialLine(row, None if row.outcome is None else Outcome.model_validate_json(row.outcome))


def _ordered(lines: Sequence[TrialLine], order: Order) -> list[TrialLine]:
    keys = {
        "failures": lambda line: (line.rank, line.row.ordinal),
        "trial": lambda line: line.row.ordinal,
        "robot": lambda line: (line.row.robot or "~", line.rank, line.row.ordinal),
        "error": lambda line: (-line.error_m if line.outcome else 1.0, line.row.ordinal),
    }
    return sorted(lines, key=keys[order])


@router.get("/jobs/{job_id}")
async def show_job(job_id: JobId, session: SignedIn, farm: TheFarm, wanted: TheWanted) -> Response:
    """The whole page."""
    made = await parts(session, farm, job_id, wanted)
    job = await jobs.get_job(job_id, session.caller, farm)
    stream = f"/jobs/{job_id}/live?order={wanted.order}&first={wanted.first}"
    return page(
        "job.html",
        session,
        parts=made,
        title=f"Job {job_id}",
        here="jobs",
        job_id=job_id,
        live=stream,
        thing=(job.object, job.object_scale),
        labels=(job.name, job.note),
    )


@router.get("/jobs/{job_id}/glimpses")
async def show_glimpses(job_id: JobId, session: SignedIn, farm: TheFarm) -> Response:
    """The few poses of each trial that its small picture is drawn from."""
    async with farm.database.read() as connection:
        row = await views.job_row(connection, job_id, session.caller.sees_only)
        ended = ended_of([_line(each) for each in await trials_of(connection, row.number)])
    found = {name: glimpse.model_dump(mode="json") for name, glimpse in sheet.glimpses(ended).items()}
    return JSONResponse(found, headers=HEADERS)


async def _seen_job(job_id: JobId, session: SignedIn, farm: TheFarm) -> Job:
    return await jobs.get_job(job_id, session.caller, farm)


@router.get("/jobs/{job_id}/live", response_class=EventSourceResponse)
async def stream_job(
    job: Annotated[Job, Depends(_seen_job)], session: live.Watching, farm: TheFarm, wanted: TheWanted
) -> AsyncIterator[ServerSentEvent]:
    """What changes on the page."""
    make = _when_changed(session, farm, job.job_id, wanted)
    async for event in live.stream(farm, session, make, lambda: farm.signals.watch(job.job_id)):
        yield event


def _when_changed(session: Session, farm: Farm, job_id: str, wanted: Wanted) -> Callable[[], Awaitable[live.Parts]]:
    """The parts of the page, made anew only when the job has another event or label, or waits for something else."""
    mark: tuple[int, str | None, str | None, str | None] | None = None
    made: live.Parts = {}

    async def make() -> live.Parts:
        nonlocal mark, made
        async with farm.database.read() as connection:
            row = await views.job_row(connection, job_id, session.caller.sees_only)
            (job,) = await views.show_jobs(connection, [row], farm.fleet, farm.clock.now_s())
        now = (row.last_event, job.waiting_because, job.name, job.note)
        if mark != now:
            mark, made = now, await parts(session, farm, job_id, wanted)
        return made

    return make


@router.get("/jobs/{job_id}/trials.csv")
async def show_table(job_id: JobId, session: SignedIn, farm: TheFarm) -> Response:
    """The trials as a table, as the API gives it, but not for whoever uses this browser next."""
    answer = await trials_as_csv(job_id, session.caller, farm)
    answer.headers.update(HEADERS)
    return answer


@router.get("/jobs/{job_id}/report")
async def show_report(job_id: JobId, session: SignedIn, farm: TheFarm, save: bool = False) -> Response:
    """The signed report: the very page that ``trifarm report --html`` writes."""
    return await report_page(job_id, session.caller, farm, save=save)


async def report_page(job_id: str, caller: Caller, farm: Farm, *, save: bool = False) -> Response:
    """The page of a report that the caller may see, with the style that it brings; ``save`` has browsers keep it as a file.

    Raises:
        NotFound: there is no such job, or it has no report of a policy.
    """
    body, _ = await stored_report(job_id, caller, farm)
    report = read_report(body)
    if not isinstance(report, Report):
        raise NotFound("report-not-a-page", f"Job {job_id} is an identification; its report has no page.")
    headers = HEADERS | {"Content-Security-Policy": f"default-src 'none'; style-src {style_source()}; frame-ancestors 'none'"}
    if save:
        headers["Content-Disposition"] = f'attachment; filename="report-{job_id}.html"'
    return HTMLResponse(render_page(report, signatures.sign(body, farm)), headers=headers)


@router.post("/jobs/{job_id}/label")
async def label(
    job_id: JobId,
    session: Changing,
    farm: TheFarm,
    name: Annotated[str, Form(max_length=LONGEST_NAME)] = "",
    note: Annotated[str, Form(max_length=2 * LONGEST_NOTE)] = "",
) -> Response:
    """Name and note as they are written in the form; an empty field takes one away."""
    kept = JobLabels(name=name, note=note.replace("\r\n", "\n")[:LONGEST_NOTE])  # a browser counts an end of line as one
    await jobs.label_job(job_id, kept, session.caller, farm)
    return RedirectResponse(f"/jobs/{job_id}", status_code=303, headers=HEADERS)


@router.post("/jobs/{job_id}/webhook")
async def set_webhook(job_id: JobId, session: Changing, farm: TheFarm, url: Annotated[WebhookUrl, Form()]) -> Response:
    """The wish to have an address called at the job's end."""
    await jobs.set_webhook(job_id, JobWebhook(url=url), session.caller, farm)
    return RedirectResponse(f"/jobs/{job_id}#notice", status_code=303, headers=HEADERS)


@router.post("/jobs/{job_id}/cancel")
async def cancel(job_id: JobId, session: Changing, farm: TheFarm) -> Response:
    """The wish to end the job, as the API takes it."""
    await jobs.cancel_job(job_id, session.caller, farm)
    return RedirectResponse(f"/jobs/{job_id}", status_code=303, headers=HEADERS)


@router.post("/jobs/{job_id}/requeue")
async def requeue(job_id: JobId, session: Operating, farm: TheFarm) -> Response:
    """The operator's wish to have a failed job tried again."""
    await jobs.requeue_job(job_id, session.caller, farm)
    return RedirectResponse(f"/jobs/{job_id}", status_code=303, headers=HEADERS)
