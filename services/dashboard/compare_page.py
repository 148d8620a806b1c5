"""The page that compares jobs on the same goals, and the list to choose them from."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Form, Query, Response
from fastapi.responses import RedirectResponse
from pydantic import Field

from api_schemas.comparison import Comparison, NotComparableError, TaskComparison, compare
from api_schemas.job import Job, JobRequest
from api_schemas.report import Report, read_report
from api_schemas.token import Scope
from services.api.farm import Farm, TheFarm
from services.api.jobs import NO_NUL, create_job, get_job, stored_report
from services.dashboard.figures import Bar
from services.dashboard.pages import HEADERS, PageRoute, page
from services.dashboard.sessions import Changing, Session, SignedIn
from services.database.rows import AnyRow
from services.errors import Forbidden, NotFound, Refused
from services.jobs.lists import comparable_jobs

router = APIRouter(route_class=PageRoute, include_in_schema=False)
MOST_JOBS = 12
JOB = r"^[a-z0-9]{1,20}$"


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
    async with farm.database.read() as connection:
        choices = await comparable_jobs(connection, session.caller.sees_only, named[0] if named else None)
    context = {
        "named": named,
        "problem": problem,
        "like": named[0] if problem else None,
        "again": await _alike(named, session, farm) if problem and session.caller.may(Scope.SUBMIT) else [],
        "choices": grouped(choices),
        "bars": _bars(found),
        "strips": _strips(found),
    }
    return page("compare.html", session, title="Compare", here="compare", found=found, **context)


async def _alike(named: Sequence[str], session: Session, farm: Farm) -> list[Job]:
    """The jobs but the first whose policies can be tried on its goals: those of its task and object."""
    first, *others = [await get_job(name, session.caller, farm) for name in named]
    asked = (first.task, first.object, first.object_scale)
    same = [each for each in others if (each.task, each.object, each.object_scale) == asked and each.policy is not None]
    return [each for each in same if each.seed != first.seed]


@router.post("/compare/again")
async def try_alike(
    like: Annotated[str, Form(pattern=JOB)], of: Annotated[str, Form(pattern=JOB)], session: Changing, farm: TheFarm
) -> Response:
    """Queues a job of the policy of ``of`` with the goals of ``like``, as ``trifarm submit --like`` does."""
    if not session.caller.may(Scope.SUBMIT):
        raise Forbidden("scope-missing", f"This needs the scope submit; the token of {session.caller.owner} does not have it.")
    first, other = [await get_job(name, session.caller, farm) for name in (like, of)]
    if other.policy is None:
        raise Refused("other-task", f"Job {of} is an identification, which has no policy.")
    asked = {"task": first.task, "object": first.object, "object_scale": first.object_scale, "trials": first.trials}
    made = await create_job(JobRequest(policy=other.policy, like=like, **asked), Response(), session.caller, farm)
    return RedirectResponse(f"/jobs/{made.job_id}", status_code=303, headers=HEADERS)


@dataclass(frozen=True)
class Choice:
    """Jobs to choose from: those that tried the same goals, or those that share theirs with no other."""

    jobs: tuple[AnyRow, ...]
    alike: bool


def grouped(rows: Sequence[AnyRow]) -> list[Choice]:
    """Jobs that can be compared with each other stand together, before those that cannot be compared with any."""
    of: dict[tuple[str, str, float, int], list[AnyRow]] = defaultdict(list)
    for row in rows:
        of[row.task, row.object, row.object_scale, row.seed].append(row)
    alike = [Choice(tuple(jobs), alike=True) for jobs in of.values() if len(jobs) > 1]
    alone = tuple(jobs[0] for jobs in of.values() if len(jobs) == 1)
    return [*alike, *([Choice(alone, alike=False)] if alone else [])]


async def _report(job_id: str, session: Session, farm: Farm) -> Report:
    body, _ = await stored_report(job_id, session.caller, farm)
    report = read_report(body)
    if not isinstance(report, Report):
        raise NotFound("report-without-goals", f"Job {job_id} is an identification, which has no goals to compare.")
    return report


def _bars(found: Comparison | None) -> list[list[Bar]]:
    tasks = () if found is None else found.tasks
    return [[Bar.of(each.policy_name, each.successes, each.trials) for each in task.jobs] for task in tasks]


def _strips(found: Comparison | None) -> list[list[int]]:
    """For each task the order in which its goals are drawn: reached by all, then those in dispute, then by none."""
    return [] if found is None else [_order(task) for task in found.tasks]


def _order(task: TaskComparison) -> list[int]:
    return sorted(range(task.goals), key=lambda index: [not done for done in task.per_goal[index].succeeded])
