"""Parts of a page that are sent again whenever they look different, as server-sent events."""

import asyncio
import json
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Annotated

from fastapi import Depends, Request
from fastapi.sse import ServerSentEvent

from services.api.farm import Farm
from services.dashboard.sessions import Session, SignedIn
from services.database.database import AWAY
from services.errors import ServiceError, TooMany

Parts = Mapping[str, str]
"""The HTML of each part by the id of its element."""
EVERY_S = 1.0
"""A page is made anew so often while somebody looks at it, and at once when its job changes."""
GATHER_S = 0.1
"""What changes within so long is shown together."""
MOST_STREAMS = 20
"""Open at the same time for one owner, over all of their browsers; each page makes its parts once a second."""
RETRY_AFTER_S = 10


@dataclass
class Streams:
    """How many streams each owner has open; belongs to the event loop."""

    _open: Counter[str] = field(default_factory=Counter)

    def opened(self, owner: str) -> None:
        """Counts one more.

        Raises:
            TooMany: the owner has ``MOST_STREAMS`` already.
        """
        if self._open[owner] >= MOST_STREAMS:
            detail = f"{owner} has {MOST_STREAMS} live pages open, the limit for a user; close some."
            raise TooMany("too-many-streams", detail, RETRY_AFTER_S)
        self._open[owner] += 1

    def closed(self, owner: str) -> None:
        """Counts one less."""
        self._open[owner] -= 1
        if not self._open[owner]:
            del self._open[owner]


async def _watching(request: Request, session: SignedIn) -> AsyncIterator[Session]:
    """The session of a stream, which is counted for as long as it lasts."""
    streams: Streams = request.app.state.dashboard_streams
    streams.opened(session.caller.owner)
    try:
        yield session
    finally:
        streams.closed(session.caller.owner)


Watching = Annotated[Session, Depends(_watching)]


async def stream(
    farm: Farm, session: Session, make: Callable[[], Awaitable[Parts]], watch: Callable[[], asyncio.Event] | None = None
) -> AsyncIterator[ServerSentEvent]:
    """The parts that differ from what was sent last; ``anew`` when the page is to be loaded again.

    That is so when there are other parts than before, and when the session ended or what is shown has gone; not when a part of
    the farm is away.

    Args:
        farm: whose end ends the stream.
        session: of whoever looks.
        make: renders all parts as they are now.
        watch: gives an event that is set at the next change of what is shown.
    """
    sent: dict[str, str] = {}
    while not farm.signals.closing.is_set():
        changed = watch() if watch else None
        try:
            await farm.tokens.caller(session.bearer)
            parts = await make() if session.lasts else {}
        except AWAY:  # what is shown stays for the moment
            await _waited(farm.signals.closing)
            continue
        except ServiceError:
            parts = {}  # the token was revoked, or what is shown has gone
        if not parts or (sent and parts.keys() != sent.keys()):
            yield ServerSentEvent(raw_data="{}", event="anew")
            return
        different = {name: html for name, html in parts.items() if sent.get(name) != html}
        if different:
            yield ServerSentEvent(raw_data=json.dumps(different), event="parts")
            sent |= different
        if await _waited(changed or farm.signals.closing):
            await asyncio.sleep(GATHER_S)


async def _waited(event: asyncio.Event) -> bool:
    with suppress(TimeoutError):
        async with asyncio.timeout(EVERY_S):
            return await event.wait()
    return False
