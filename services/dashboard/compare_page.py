"""The page that compares jobs on the same goals, and the list to choose them from."""

from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Query, Response
from pydantic import Field
from sqlalchemy import select

from api_schemas.comparison import Comparison, NotComparableError, TaskComparison, compare
from api_schemas.job import JobState, TaskName
from api_schemas.report import Report, read_report
from services.api.farm import Farm, TheFarm
from services.api.jobs import stored_report
from services.dashboard.figures import Bar
from services.dashboard.jobs_page import NO_NUL
from services.dashboard.pages import PageRoute, page
from services.dashboard.sessions import Session, SignedIn
from services.database.rows import AnyRow
from services.database.tables import job
from services.errors import NotFound, Refused

router = APIRouter(route_class=PageRoute, include_in_schema=False)
MOST_JOBS = 12
TO_CHOOSE_FROM = 40


@router.get("/compare")
async def show_comparison(
    session: SignedIn,
    farm: TheFarm,
    jobs: Annotated[str, Query(max_length=400, pattern=NO_NUL)] = "",
    job_ids: Annotated[list[Annotated[str, Field(pattern=NO_NUL)]] | None, Query(alias="job", max_length=MOST_JOBS)] = None,
) -> Response:
    """Compares the jobs that the address names, ``jobs=a,b`` or ``job=a&job=b``; of fewer than two, asks for more."""
    named = list(dict.fromkeys(name for name in (*jobs.split(","), *(job_ids or [])) if name))
    if len(named) > MOST_JOBS:
        raise Refused("too-many-jobs", f"{len(named)} jobs are named; at most {MOST_JOBS} are compared at once.")
    found, problem = None, None
    if len(named) > 1:
        try:
            found = compare([await _report(name, session, farm) for name in named])
        except NotComparableError as error:
            problem = f"These jobs cannot be compared: {error}."
    choices = await _choices(session, farm, named[0] if named else None)
    context = {"named": named, "problem": problem, "choices": choices, "bars": _bars(found), "strips": _strips(found)}
    return page("compare.html", session, title="Compare", here="compare", found=found, **context)


async def _report(job_id: str, session: Session, farm: Farm) -> Report:
    body, _ = await stored_report(job_id, session.caller, farm)
    report = read_report(body)
    if not isinstance(report, Report):
        raise NotFound("report-without-goals", f"Job {job_id} is an identification, which has no goals to compare.")
    return report


async def _choices(session: Session, farm: Farm, first: str | None) -> Sequence[AnyRow]:
    """The newest jobs with a report; with a first one chosen, those of its task and seed before the rest."""
    ended = select(job).where(job.c.state == JobState.SUCCEEDED, job.c.task != TaskName.IDENTIFY)
    if session.caller.sees_only is not None:
        ended = ended.where(job.c.owner == session.caller.sees_only)
    newest = ended.order_by(job.c.number.desc()).limit(TO_CHOOSE_FROM)
    async with farm.database.read() as connection:
        rows = list((await connection.execute(newest)).all())
        if first is None:
            return rows
        chosen = (await connection.execute(ended.where(job.c.job_id == first))).one_or_none()
        if chosen is None:
            return rows
        same = ended.where(job.c.task == chosen.task, job.c.object == chosen.object, job.c.seed == chosen.seed)
        alike = (await connection.execute(same.order_by(job.c.number.desc()).limit(TO_CHOOSE_FROM))).all()
    known = {row.number for row in alike}
    return [*alike, *(row for row in rows if row.number not in known)]


def _bars(found: Comparison | None) -> list[list[Bar]]:
    tasks = () if found is None else found.tasks
    return [[Bar.of(each.policy_name, each.successes, each.trials) for each in task.jobs] for task in tasks]


def _strips(found: Comparison | None) -> list[list[int]]:
    """For each task the order in which its goals are drawn: reached by all, then those in dispute, then by none."""
    return [] if found is None else [_order(task) for task in found.tasks]


def _order(task: TaskComparison) -> list[int]:
    return sorted(range(task.goals), key=lambda index: [not done for done in task.per_goal[index].succeeded])
