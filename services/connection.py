"""A connection as uvicorn serves it, but one on which no request comes is closed: uvicorn by itself waits for ever for the first.

Anybody may open connections, without a token and without a word, and each holds a file that the process has open.
"""

import asyncio

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol


class Connection(HttpToolsProtocol):
    """One client's connection; owner of the timer that runs while no request is under way and uvicorn's own does not.

    The head of a request has ``head_within_s`` seconds from its first byte, that of the first one from the beginning of the
    connection. The rest of a body that was answered before it had come is thrown away while something of it comes so often.
    """

    head_within_s = 10.0
    _ends: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begins to wait for the first request."""
        super().connection_made(transport)
        self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Waits for nothing more."""
        self._wait_no_more()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Takes in what came; uvicorn has stopped its own timer by then, also for a byte that begins no request."""
        super().data_received(data)
        is_asked = self.cycle is not None and not self.cycle.response_complete
        has_left = self.transport.is_closing() or self.transport.get_protocol() is not self
        if self._ends is None and not is_asked and not has_left:
            self._wait()

    def on_headers_complete(self) -> None:
        """The head is there: what follows has limits of its own."""
        self._wait_no_more()
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Takes in a part of a body."""
        self._wait_no_more()  # begins again with the end of ``data_received`` where the request was answered already
        super().on_body(body)

    def _wait(self) -> None:
        self._ends = self.loop.call_later(self.head_within_s, self.timeout_keep_alive_handler)

    def _wait_no_more(self) -> None:
        if self._ends is not None:
            self._ends.cancel()
            self._ends = None


def connection(head_within_s: float) -> type[Connection]:
    """The class of connections on which the head of a request must come within ``head_within_s``, in seconds."""
    return type("Connection", (Connection,), {"head_within_s": head_within_s})
