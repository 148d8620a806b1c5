"""The bus alone: a zenoh router for farms whose services and robots run in processes or containers of their own."""

import asyncio
import faulthandler
import os
import signal

import structlog

from api_schemas.bus import is_guarded
from services.dispatcher.bus import Bus
from services.joining.session import session_config
from services.settings import Settings

log = structlog.get_logger()
PARENT_LOOK_S = 0.5
END_WITHIN_S = 9.0
"""Longer than an orderly end takes, whose parts wait some seconds at the most, unless one waits for a lock of the database. A
container is killed after 10.
"""
STANDARD_ERROR = 2


async def route(settings: Settings) -> None:
    """Routes until SIGINT, SIGTERM or the end of the parent process."""
    bus = await Bus.open(session_config(settings, None), settings.farm)
    log.info("routing", bus=settings.bus, guarded=is_guarded(settings.bus))
    try:
        await told_to_stop()
        end_in_time()
    finally:
        await bus.close()


async def told_to_stop() -> str:
    """Waits for SIGINT, SIGTERM or the end of the parent process; says which."""
    told, parent = asyncio.Event(), os.getppid()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, told.set)
    while not told.is_set() and os.getppid() == parent:
        try:
            async with asyncio.timeout(PARENT_LOOK_S):
                await told.wait()
        except TimeoutError:
            continue
    return "told to" if told.is_set() else "the parent process has gone"


def end_in_time() -> None:
    """From now on the process has ``END_WITHIN_S`` to end by itself.

    One that does not says in standard error where its threads stand, and is ended. Whatever was acknowledged is in the database,
    and the rest is taken back there.
    """
    faulthandler.dump_traceback_later(END_WITHIN_S, file=STANDARD_ERROR, exit=True)
