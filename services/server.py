"""The HTTP server of one process: which connections it gives up, and how it ends."""

import asyncio
import functools
import socket
from asyncio import sslproto
from collections.abc import Iterator
from contextlib import contextmanager

import uvicorn

from services.connection import TLS_BUFFER_BYTES

END_AGAIN_S = 0.05
BROKEN_OFF_WITHIN_S = 1.0
SILENT_AT_MOST_S = 12
"""A reader who acknowledges nothing for so long, or takes nothing in, is gone. A stream says something every 15 s at the least,
so that it ends within 27 s."""
VANISHED = (
    (socket.SOL_SOCKET, "SO_KEEPALIVE", 1),
    (socket.IPPROTO_TCP, "TCP_KEEPIDLE", 4),
    (socket.IPPROTO_TCP, "TCP_KEEPINTVL", 4),
    (socket.IPPROTO_TCP, "TCP_USER_TIMEOUT", 1000 * SILENT_AT_MOST_S),
)
"""Options of sockets, which Linux has and others in part."""


class Server(uvicorn.Server):
    """uvicorn without its signal handlers: this process has its own order of ending.

    Args:
        config: uvicorn's.
        handshake_within_s: a connection over TLS that has not shaken hands by then is closed.
    """

    def __init__(self, config: uvicorn.Config, handshake_within_s: float) -> None:
        super().__init__(config)
        self._handshake_within_s = handshake_within_s

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listens so that a connection whose other side is gone without a word ends, and with it a stream that waits."""
        with self._bounded_tls():
            await super().startup(sockets)
        for listening in (each for server in getattr(self, "servers", ()) for each in server.sockets):
            for level, name, value in VANISHED:
                if hasattr(socket, name):
                    listening.setsockopt(level, getattr(socket, name), value)  # those that it accepts have them from it

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Ends also connections that came while it closed: uvicorn tells those of one moment, and a busy client keeps its own."""
        telling = asyncio.create_task(self._end_connections())
        try:
            await super().shutdown(sockets)
            if broken_off := set(self.server_state.tasks):  # they give back what they have of the database
                await asyncio.wait(broken_off, timeout=BROKEN_OFF_WITHIN_S)
        finally:
            telling.cancel()

    async def _end_connections(self) -> None:
        while True:
            for each in list(self.server_state.connections):
                each.shutdown()
            await asyncio.sleep(END_AGAIN_S)

    @contextmanager
    def _bounded_tls(self) -> Iterator[None]:
        """Uvicorn hands neither the time of a handshake (asyncio waits a minute) nor the size of a buffer on."""
        if not self.config.is_ssl:
            yield
            return
        sslproto.SSLProtocol.max_size = TLS_BUFFER_BYTES
        loop = asyncio.get_running_loop()
        create = loop.create_server
        bounded = functools.partial(create, ssl_handshake_timeout=self._handshake_within_s)
        loop.create_server = bounded
        try:
            yield
        finally:
            loop.create_server = create

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leaves signals to ``serve``."""
        yield
