"""Computes why trials failed, one at a time, in a niced and jailed child process beside all requests."""

import asyncio
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import structlog

from api_schemas.why import Why
from jail.level import JailLevel
from services.database.database import Database
from services.database.rows import AnyRow
from services.errors import ServiceError
from services.files.store import FileStore
from services.jobs import whys
from services.jobs.clock import FarmClock
from services.verification.explaining import CannotExplainError, explain

log = structlog.get_logger()
LOOK_EVERY_S = 1.0
SPARE_S = 30.0
"""Beyond its deadline a question is held so long: files come and go."""


@dataclass(frozen=True)
class Explainer:
    """Takes questions in the order of their coming. Several processes may have one each: a question is held by one of them."""

    database: Database
    files: FileStore
    clock: FarmClock
    jail_level: JailLevel
    deadline_s: float

    async def explain_due(self) -> None:
        """Answers the questions that are due, one after the other."""
        while await self.explain_next():
            pass

    async def explain_next(self) -> bool:
        """Answers the next question; gives whether there was one."""
        now_s = self.clock.now_s()
        async with self.database.read() as connection:
            if not await whys.any_due(connection, now_s):
                return False
        async with self.database.write() as tx:
            taken = await whys.take(tx, now_s, self.deadline_s + SPARE_S)
        if taken is None:
            return False
        found, problem = await self._answer(taken)
        async with self.database.write() as tx:
            await whys.answer(tx, taken.trial_id, found, problem)
        log.info("why", trial=taken.trial_id, verdict=None if found is None else found.verdict.value, problem=problem)
        return True

    async def _answer(self, taken: AnyRow) -> tuple[Why | None, str | None]:
        """What comes of this try.

        Raises:
            OSError: this machine could not do it, such as on a full disk; the question is held, then due again.
        """
        try:
            return await self._computed(taken)
        except OSError as error:
            if taken.tries < whys.MOST_TRIES:
                raise
            log.warning("why a trial failed was not computed", trial=taken.trial_id, reason=str(error))
            said = os.strerror(error.errno) if error.errno else type(error).__name__
            hint = "the farm's operator can see to it"
            return None, f"the farm could not copy its files or start the replays, {taken.tries} times ({said}); {hint}"

    async def _computed(self, taken: AnyRow) -> tuple[Why | None, str | None]:
        with tempfile.TemporaryDirectory(prefix="trifarm-why-") as name:
            folder = Path(name)
            try:
                for sha256, file in (
                    (taken.log_sha256, "log.mcap"),
                    (taken.truth_sha256, "truth.mcap"),
                    (taken.graph_sha256, "graph.onnx"),
                ):
                    await self._write(folder / file, sha256)
                return await explain(folder, self.jail_level, self.deadline_s), None
            except CannotExplainError as error:
                return None, str(error)
            except ServiceError as error:
                return None, f"its files cannot be read: {error.detail}"

    async def _write(self, path: Path, sha256: str) -> None:
        with path.open("xb") as file:
            try:
                async for chunk in self.files.read(sha256):
                    await asyncio.to_thread(file.write, chunk)
            except FileNotFoundError as error:  # which writing to an open file is not
                removed = "a file that it needs is gone: its log, its truth or its policy was removed from the farm"
                raise CannotExplainError(removed) from error
