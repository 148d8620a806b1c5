"""A page that cannot be shown for now comes back by itself, in a browser that nobody sits at."""

import re

import httpx
import pytest
from fastapi import APIRouter, FastAPI
from sqlalchemy.exc import OperationalError

from api_schemas.job import Job, JobState, TaskName
from services.dashboard.pages import PageRoute, part
from services.errors import NotFound, TooMany, Unavailable


async def answer_of(error, method="GET"):
    router = APIRouter(route_class=PageRoute)

    @router.api_route("/jobs", methods=["GET", "POST"])
    async def failing():
        raise error

    app = FastAPI()
    app.include_router(router)
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://farm") as browser:
        return await browser.request(method, "/jobs", headers={"Accept": "text/html"})


@pytest.mark.parametrize(
    "error, status, after_s",
    [
        (Unavailable("database-unavailable", "The database did not answer"), 503, "5"),
        (OperationalError("SELECT 1", None, OSError("it was stopped")), 503, "5"),
        (TooMany("too-many-streams", "close some", 10), 429, "10"),
        (NotFound("job-not-found", "There is no such job"), 404, None),
    ],
)
async def test_what_is_so_for_now_only_is_asked_for_again(error, status, after_s):
    answer = await answer_of(error)
    assert (answer.status_code, answer.headers.get("refresh")) == (status, after_s)


async def test_what_was_sent_is_not_sent_again():
    answer = await answer_of(Unavailable("database-unavailable", "The database did not answer"), "POST")
    assert (answer.status_code, answer.headers.get("refresh")) == (503, None)


@pytest.mark.parametrize("running, may", [(0, True), (2, False)])
def test_a_failed_job_is_queued_again_only_when_its_robots_have_stopped(running, may):
    job = Job(
        job_id="job-1", state=JobState.FAILED, waiting_because=None, policy=None, policy_name="a policy", task=TaskName.PUSH,
        trials=3, seed=7, seed_drawn_by_server=False, owner="ann", created_at="2026-01-01T00:00:00+00:00", started_at=None,
        ended_at=None, trials_done=1, trials_running=running, successes=0, policy_faults=0, platform_faults=1,
    )  # fmt: skip
    head = part("job/head.html", job=job, csrf="word", ended=True, operates=True)
    (button,) = re.findall("<button id=.requeue[^>]*>", head)
    assert ("disabled" not in button) is may
    assert ("2 trials still being stopped by their robots" in button) is not may
