"""Routes of a job's history: server-sent events that resume, and a long poll for those who cannot keep a stream."""

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query, Request
from fastapi.sse import EventSourceResponse, ServerSentEvent

from api_schemas.job import FINAL_JOB_STATES, EventKind, JobEvent
from services.api.access import User
from services.api.at_once import one_more
from services.api.farm import Farm, TheFarm
from services.api.jobs import JobId
from services.database.rows import AnyRow
from services.errors import Refused, TooMany
from services.jobs import views
from services.jobs.events import PAGE, events_after

router = APIRouter(prefix="/v1/jobs/{job_id}", tags=["jobs"])
LONG_POLL_S = 20.0
LOOK_AGAIN_S = 2.0
"""Readers look again after so long though nobody woke them: another process may have written."""
GATHER_S = 0.1
"""A stream waits so long after a wake-up: a short trial is leased, runs and ends within it, and is read and sent at once."""
MOST_READERS = 20
"""Streams and long polls of one owner at the same time; each asks the database every two seconds."""
RETRY_AFTER_S = 10


async def _job(job_id: JobId, caller: User, farm: TheFarm) -> AnyRow:
    async with farm.database.read() as connection:
        return await views.job_row(connection, job_id, caller.sees_only)


async def _counted(row: Annotated[AnyRow, Depends(_job)], caller: User, request: Request) -> AsyncIterator[AnyRow]:
    """The job of a reader, who is counted for as long as they read."""
    detail = f"{caller.owner} has {MOST_READERS} streams and long polls of events open, the limit for a user; close some."
    refusal = TooMany("too-many-event-readers", detail, RETRY_AFTER_S)
    with one_more(request.app.state.event_readers, caller, MOST_READERS, refusal):
        yield row


async def _last_seen(last_event_id: Annotated[str | None, Header(alias="Last-Event-ID")] = None) -> int:
    text = last_event_id or "0"
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise Refused("bad-event-id", f"Last-Event-ID is {text!r}; it must be the id of an event of this job.")
    return int(text)


OwnJob = Annotated[AnyRow, Depends(_counted)]
LastSeen = Annotated[int, Depends(_last_seen)]


@router.get("/events", response_class=EventSourceResponse)
async def stream_events(row: OwnJob, last_seen: LastSeen, farm: TheFarm) -> AsyncIterator[ServerSentEvent]:
    """Every event after Last-Event-ID, then each new one, until the job's last."""
    while not farm.signals.closing.is_set():
        changed = farm.signals.watch(row.job_id)
        found = await _read(farm, row, last_seen)
        for event in found:
            yield ServerSentEvent(data=event, event=event.kind, id=str(event.id))
            last_seen = event.id
            if event.kind == EventKind.JOB_ENDED:
                return
        if await _over(farm, row, last_seen):
            return
        if len(found) < PAGE and await _woken(changed, LOOK_AGAIN_S):
            await asyncio.sleep(GATHER_S)


@router.get("/history")
async def get_history(row: OwnJob, farm: TheFarm, after: Annotated[int, Query(ge=0, le=2**31 - 1)] = 0) -> tuple[JobEvent, ...]:
    """The events after ``after``; when there are none yet, waits for one up to 20 s."""
    if await _over(farm, row, after):
        return ()
    return await _wait_for(farm, row, after, LONG_POLL_S)


async def _wait_for(farm: Farm, row: AnyRow, after: int, longest_s: float) -> tuple[JobEvent, ...]:
    changed = farm.signals.watch(row.job_id)
    found = await _read(farm, row, after)
    if found or farm.signals.closing.is_set():
        return found
    await _woken(changed, longest_s)
    return await _read(farm, row, after)


async def _woken(changed: asyncio.Event, longest_s: float) -> bool:
    try:
        async with asyncio.timeout(longest_s):
            return await changed.wait()
    except TimeoutError:
        return False


async def _read(farm: Farm, row: AnyRow, after: int) -> tuple[JobEvent, ...]:
    async with farm.database.read() as connection:
        return await events_after(connection, row.number, after)


async def _over(farm: Farm, row: AnyRow, seen: int) -> bool:
    """Whether the job has ended and its reader has seen all that it will ever have."""
    async with farm.database.read() as connection:
        now = await views.job_row(connection, row.job_id, None)
    return now.state in FINAL_JOB_STATES and seen >= now.last_event
