"""Replays: logs reduced to what a browser draws, each made once, in a jail, and kept as a file."""

import asyncio
import gzip
import os
import stat
import tempfile
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from fastapi import Depends, Request, Response
from fastapi.responses import FileResponse

from jail.level import too_open
from services.api.farm import Farm
from services.api.serving import stored_size
from services.child_process import ChildKilledError, run_module
from services.dashboard.bringing import UnreadableError, bring
from services.dashboard.pages import HEADERS, takes_gzip
from services.dashboard.replay_limits import DEADLINE_S, LARGEST_REPLAY_BYTES
from services.errors import Unavailable
from services.turns import Turns

BINARY = "application/octet-stream"
FORM = 6
"""Of what a replay holds; one of an earlier form is made again."""
KEPT_BYTES = 1024**3
"""Of reduced logs; those that were not looked at for longest go first, and are made again from their logs."""
COUNTED_BYTES = 64 * 1024
"""What a kept file counts at least, so that small ones do not become too many."""
AT_ONCE = 1
MEASURED, IMAGES = "measured", "images"


@dataclass
class Replays:
    """Reduced logs as files, named by what they were made of; belongs to the event loop."""

    folder: Path
    _turns: Turns = field(default_factory=lambda: Turns(AT_ONCE))

    async def reduced(self, farm: Farm, reader: str, log: str, truth: str | None) -> Path:
        """The replay of a log, with what a truth adds to it, as gzip packs it; ``reader`` is the owner whose turn it takes.

        Raises:
            Unavailable: the log cannot be read, or not in time, or the farm's jail is too open to read any.
            TooMany: too many of the reader's requests wait for theirs.
        """
        path = self.folder / f"{log}{'' if truth is None else f'-{truth}'}-{FORM}.gz"
        return await self._kept(farm, reader, path, [log] if truth is None else [log, truth])

    async def measured(self, farm: Farm, reader: str, log: str) -> Path:
        """The replay of what a log's robot measured, without the truth that logs of ideal robots have beside it.

        Raises:
            Unavailable, TooMany: as ``reduced``.
        """
        return await self._kept(farm, reader, self.folder / f"{log}-{MEASURED}-{FORM}.gz", [log], MEASURED)

    async def images(self, farm: Farm, reader: str, log: str) -> Path:
        """What the cameras of a log's trial saw.

        Raises:
            Unavailable, TooMany: as ``reduced``.
        """
        return await self._kept(farm, reader, self.folder / f"{log}-{IMAGES}-{FORM}.gz", [log], IMAGES)

    async def _kept(self, farm: Farm, reader: str, path: Path, sources: list[str], *how: str) -> Path:
        if not await asyncio.to_thread(_renewed, path):
            async with self._turns.of(reader):
                if not await asyncio.to_thread(_renewed, path):
                    await self._make(farm, path, sources, *how)
        return path

    async def _make(self, farm: Farm, path: Path, sources: list[str], *how: str) -> None:
        if (reason := too_open(farm.jail, farm.settings.jail_level)) is not None:
            raise Unavailable("jail-too-open", f"The farm reads no logs now: {reason}. Its operator can change that.")
        with tempfile.TemporaryDirectory(prefix="trifarm-replay-") as name:
            files = [Path(name) / f"{index}.mcap" for index in range(len(sources))]
            try:
                for file, sha256 in zip(files, sources, strict=True):
                    await bring(farm.files, sha256, await stored_size(farm.files, sha256), file, plan_in)
            except UnreadableError as error:
                raise _failed() from error
            made = await reduce_in(Path(name), *(file.name for file in files), how=how)
        await asyncio.to_thread(lambda: self.keep(path, gzip.compress(made, compresslevel=6, mtime=0)))

    def keep(self, path: Path, made: bytes) -> None:
        """Writes a replay, and makes room for it if need be."""
        self.folder.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(".new")
        unfinished.write_bytes(made)
        unfinished.replace(path)
        total = 0
        for _, size, kept in sorted(_looked_at(self.folder), reverse=True):
            total += max(size, COUNTED_BYTES)
            if total > KEPT_BYTES and kept != path:
                kept.unlink(missing_ok=True)


def _renewed(path: Path) -> bool:
    """Whether the replay is kept; from now on it counts as looked at now."""
    try:
        os.utime(path)
    except FileNotFoundError:
        return False
    return True


def _looked_at(folder: Path) -> list[tuple[float, int, Path]]:
    """When each kept file was looked at last, and its bytes; also those that a crash left unfinished."""
    found = []
    for path in folder.iterdir():
        with suppress(FileNotFoundError):  # another process that serves the farm may make room too
            known = path.stat()
            found.append((known.st_mtime, known.st_size, path))
    return found


async def reduce_in(folder: Path, log: str, truth: str | None = None, how: tuple[str, ...] = ()) -> bytes:
    """The reduced log; both are names of files in ``folder``, which the jailed process comes to own; ``how`` may leave out truth.

    Raises:
        Unavailable: the log cannot be read, or not within the limits.
    """
    options = [f"--{each}" for each in how]
    return await _made(folder, "replay.bin", [*options, log, "replay.bin", *([] if truth is None else [truth])])


async def plan_in(log: Path) -> bytes:
    """The byte ranges that the reduction of a large log wants, as the jailed process that read its summary tells.

    Raises:
        Unavailable: the summary cannot be read, or not within the limits.
    """
    return await _made(log.parent, "plan.json", ["--plan", log.name, "plan.json"])


async def _made(folder: Path, name: str, arguments: list[str]) -> bytes:
    """The file that a jailed process was to make."""
    try:
        ended = await run_module("services.dashboard.reduction", *arguments, folder=folder, deadline_s=DEADLINE_S)
        made = await asyncio.to_thread(_read, folder / name) if ended.status == 0 else None
    except (ChildKilledError, OSError) as error:
        raise _failed() from error
    if made is None:
        raise _failed()
    return made


def _read(path: Path) -> bytes | None:
    """What the jailed process left, which may be anything if the log had won it over."""
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
        known = os.fstat(file.fileno())
        if not stat.S_ISREG(known.st_mode) or known.st_size > LARGEST_REPLAY_BYTES:
            return None
        return file.read(LARGEST_REPLAY_BYTES)


async def _replays(request: Request) -> Replays:
    return request.app.state.dashboard_replays


TheReplays = Annotated[Replays, Depends(_replays)]


async def sent(path: Path, request: Request) -> Response:
    """A replay as the answer, packed for whoever can unpack it."""
    headers = HEADERS | {"Vary": "Accept-Encoding"}
    if takes_gzip(request):
        return FileResponse(path, media_type=BINARY, headers=headers | {"Content-Encoding": "gzip"})
    return Response(await asyncio.to_thread(lambda: gzip.decompress(path.read_bytes())), media_type=BINARY, headers=headers)


def _failed() -> Unavailable:
    detail = "The log could not be read for a replay; download it, or have an operator look at it."
    return Unavailable("replay-failed", detail)
