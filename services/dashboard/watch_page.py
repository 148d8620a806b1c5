"""A running trial as it happens: what its robot shows ten times a second, sent on to whoever may see the trial."""

import asyncio
import json
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.sse import EventSourceResponse, ServerSentEvent

from api_schemas.bus import LiveState
from api_schemas.trial import Trial
from services.api import trials
from services.api.farm import Farm, TheFarm
from services.api.trials import TrialId
from services.dashboard import live
from services.dashboard.pages import PageRoute
from services.dashboard.sessions import Session, SignedIn
from services.errors import TooMany
from services.jobs.fleet import Member

router = APIRouter(route_class=PageRoute, include_in_schema=False)
MOST_WATCHING = 40
"""Viewers of running trials at the same time, of all owners together: each gets ten messages a second."""
MOST_OF_OWNER = 15
"""Of these of one owner: below half, so that viewers who went without a word keep no third owner out."""
SHORTEST_S = 0.08
"""Between two messages to a viewer, however often a robot shows itself; a robot does so ten times a second."""
LOOK_AGAIN_S = 1.0
RETRY_AFTER_S = 30
SHORT = (",", ":")
DIGITS = 4
"""Of metres and radians."""


@dataclass
class Watching:
    """How many watch of each owner; belongs to the event loop."""

    _open: Counter[str] = field(default_factory=Counter)

    def opened(self, owner: str) -> None:
        """Counts one more.

        Raises:
            TooMany: the owner, or all together, have as many as may be.
        """
        if self._open[owner] >= MOST_OF_OWNER:
            detail = f"{owner} already watches trials on {MOST_OF_OWNER} pages, the limit for a user; close some."
            raise TooMany("too-many-watching", detail, RETRY_AFTER_S)
        if self._open.total() >= MOST_WATCHING:
            detail = (
                f"{MOST_WATCHING} people already watch trials, the limit of this farm; the replay is there when the trial ends."
            )
            raise TooMany("too-many-watching", detail, RETRY_AFTER_S)
        self._open[owner] += 1

    def closed(self, owner: str) -> None:
        """Counts one less."""
        self._open[owner] -= 1
        if not self._open[owner]:
            del self._open[owner]


async def _watching(request: Request, session: live.Watching) -> AsyncIterator[Session]:
    """The session of somebody who watches, counted among all for as long as they do."""
    watching: Watching = request.app.state.dashboard_watching
    watching.opened(session.caller.owner)
    try:
        yield session
    finally:
        watching.closed(session.caller.owner)


async def _seen(trial_id: TrialId, session: SignedIn, farm: TheFarm) -> Trial:
    return await trials.get_trial(trial_id, session.caller, farm)


@router.get("/trials/{trial_id}/watch", response_class=EventSourceResponse)
async def watch_trial(
    trial: Annotated[Trial, Depends(_seen)], session: Annotated[Session, Depends(_watching)], farm: TheFarm
) -> AsyncIterator[ServerSentEvent]:
    """``state`` whenever the robot shows itself, ``over`` when it does not run this trial any more."""
    shown: LiveState | None = None
    while not farm.signals.closing.is_set() and session.lasts:
        member = holder(farm, trial)
        if member is None:
            yield ServerSentEvent(raw_data="{}", event="over")
            return
        moved = farm.signals.watch_robot(member.robot)
        if member.live is not None and member.live is not shown:
            shown = member.live
            yield ServerSentEvent(raw_data=message(shown), event="state")
            await asyncio.sleep(SHORTEST_S)
        with suppress(TimeoutError):
            async with asyncio.timeout(LOOK_AGAIN_S):
                await moved.wait()


def holder(farm: Farm, trial: Trial) -> Member | None:
    """The robot that has a lease for the trial now."""
    held = (each for each in farm.fleet.members.values() if each.lease is not None and each.lease.trial_id == trial.trial_id)
    return next(held, None)


def message(state: LiveState) -> str:
    """What a viewer gets: measured joints, tracked object, goal and time."""
    rounded = {
        "joints": [round(each, DIGITS) for each in state.joint_position_rad],
        "tracked": [round(each, DIGITS) for each in (*state.tracked_cube_position_world_m, *state.tracked_cube_quat_wxyz)],
        "goal": None if state.goal is None else [round(each, DIGITS) for each in state.goal],
    }
    return json.dumps(
        rounded | {"t_s": round(state.simulated_s, 3), "duration_s": state.duration_s}, separators=SHORT, allow_nan=False
    )
