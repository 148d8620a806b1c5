"""Parts of a page that are sent again whenever they look different, as server-sent events."""

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import suppress

from fastapi.sse import ServerSentEvent

from services.api.farm import Farm
from services.dashboard.sessions import Session
from services.errors import ServiceError

Parts = Mapping[str, str]
"""The HTML of each part by the id of its element."""
EVERY_S = 1.0
"""A page is made anew so often while somebody looks at it, and at once when its job changes."""
GATHER_S = 0.1
"""What changes within so long is shown together."""


async def stream(
    farm: Farm, session: Session, make: Callable[[], Awaitable[Parts]], watch: Callable[[], asyncio.Event] | None = None
) -> AsyncIterator[ServerSentEvent]:
    """The parts that differ from what was sent last; ``anew`` when the page is to be loaded again.

    That is so when there are other parts than before, and when the token was revoked or what is shown has gone.

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
            parts = await make()
        except ServiceError:
            parts = {}
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
