"""The page of one trial: replayed in three dimensions from its log, beside what was measured, with one time for all."""

import asyncio
import tempfile
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import FileResponse
from sqlalchemy import select

from api_schemas.token import Scope
from api_schemas.trial import Trial
from services.api import jobs, trials
from services.api.farm import Farm, TheFarm
from services.api.trials import TrialId
from services.child import ChildKilledError, run_module
from services.dashboard.pages import HEADERS, PageRoute, page
from services.dashboard.sessions import Session, SignedIn
from services.database.tables import trial as trial_table
from services.errors import NotFound, Unavailable

router = APIRouter(route_class=PageRoute, include_in_schema=False)
REDUCED_WITHIN_S = 60.0
KEPT_REPLAYS = 200
"""Reduced logs that are kept; others are made again from their logs."""
AT_ONCE = 1


@dataclass
class Replays:
    """Reduced logs as files, named by what they were made of; belongs to the event loop."""

    folder: Path
    _turn: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(AT_ONCE))

    async def reduced(self, farm: Farm, log: str, truth: str | None) -> Path:
        """The replay of a log, with what a truth adds to it.

        Raises:
            Unavailable: the log cannot be read, or not in time.
        """
        path = self.folder / f"{log}{'' if truth is None else f'-{truth}'}.bin"
        async with self._turn:
            if not path.exists():
                await self._make(farm, path, [log] if truth is None else [log, truth])
            await asyncio.to_thread(path.touch)
        return path

    async def _make(self, farm: Farm, path: Path, sources: list[str]) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="trifarm-replay-") as name:
            folder = Path(name)
            for index, sha256 in enumerate(sources):
                await _write(folder / f"{index}.mcap", farm.files.read(sha256))
            arguments = ["0.mcap", "replay.bin", *(["1.mcap"] if len(sources) > 1 else [])]
            try:
                await run_module("services.dashboard.reduction", *arguments, folder=folder, deadline_s=REDUCED_WITHIN_S)
                made = await asyncio.to_thread((folder / "replay.bin").read_bytes)
            except (ChildKilledError, FileNotFoundError) as error:
                detail = "The log could not be read for a replay; download it, or have an operator look at it."
                raise Unavailable("replay-failed", detail) from error
        await asyncio.to_thread(self._keep, path, made)

    def _keep(self, path: Path, made: bytes) -> None:
        unfinished = path.with_suffix(".new")
        unfinished.write_bytes(made)
        unfinished.replace(path)
        kept = sorted(self.folder.glob("*.bin"), key=lambda each: each.stat().st_mtime)
        for old in kept[:-KEPT_REPLAYS]:
            old.unlink(missing_ok=True)


async def _write(path: Path, chunks: AsyncIterator[bytes]) -> None:
    with path.open("xb") as file:
        async for chunk in chunks:
            await asyncio.to_thread(file.write, chunk)


def _replays(request: Request) -> Replays:
    return request.app.state.dashboard_replays


@router.get("/trials/{trial_id}")
async def show_trial(trial_id: TrialId, session: SignedIn, farm: TheFarm) -> Response:
    """The page; what is drawn comes after it."""
    shown = await trials.get_trial(trial_id, session.caller, farm)
    job = await jobs.get_job(shown.job_id, session.caller, farm)
    title = f"Trial {shown.ordinal} of {job.policy_name or 'an identification'}"
    neighbours = (shown.ordinal - 1 if shown.ordinal else None, shown.ordinal + 1 if shown.ordinal + 1 < job.trials else None)
    context = {"trial": shown, "job": job, "neighbours": neighbours, "sees_truth": _sees_truth(session, shown)}
    return page("trial.html", session, title=title, here="jobs", **context)


def _sees_truth(session: Session, shown: Trial) -> bool:
    return shown.has_truth and session.caller.may(Scope.OPERATE)


@router.get("/trials/{trial_id}/replay")
async def get_replay(
    trial_id: TrialId, session: SignedIn, farm: TheFarm, replays: Annotated[Replays, Depends(_replays)]
) -> Response:
    """What is drawn of a trial; its truth only for those who may see it."""
    shown = await trials.get_trial(trial_id, session.caller, farm)
    if shown.log_sha256 is None:
        raise NotFound("log-not-found", f"Trial {trial_id} is {shown.state} and has no log; logs come with accepted outcomes.")
    truth = None
    if _sees_truth(session, shown):
        async with farm.database.read() as connection:
            wanted = select(trial_table.c.truth_sha256).where(trial_table.c.trial_id == trial_id)
            truth = (await connection.execute(wanted)).scalar_one()
    path = await replays.reduced(farm, shown.log_sha256, truth)
    return FileResponse(path, media_type="application/octet-stream", headers=HEADERS)


@router.get("/trials/{trial_id}/log")
async def get_log(trial_id: TrialId, request: Request, session: SignedIn, farm: TheFarm) -> Response:
    """The log itself, as the API serves it, but not for whoever uses this browser next."""
    answer = await trials.get_log(trial_id, request, session.caller, farm)
    answer.headers.update(HEADERS)
    return answer
