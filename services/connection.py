"""A connection as uvicorn serves it, but within bounds: no request may be waited for for ever, and no head may be of any size.

Anybody may open connections, without a token and without a word, and each holds a file that the process has open, and memory.
"""

import asyncio
import json

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

MOST_HEAD_BYTES = 16 << 10
MOST_HEADERS = 100
MOST_PIPELINED = 4
"""Requests that one connection may send before the first is answered: each is parsed as it comes, and waits in memory."""
TLS_BUFFER_BYTES = 16 << 10
"""What asyncio reads into of a connection over TLS, from its beginning on; its own 256 KiB are for few fast connections."""


class HeadTooLarge(Exception):
    """The parser stops, and the connection with it."""


class Connection(HttpToolsProtocol):
    """One client's connection; owner of the timer that runs while no request is under way and uvicorn's own does not.

    A head has at most ``MOST_HEAD_BYTES`` in ``MOST_HEADERS``; a larger one is answered 431 before anything of it is used.

    The head of a request has ``head_within_s`` seconds from its first byte, that of the first one from the beginning of the
    connection. The rest of a body that was answered before it had come is thrown away while something of it comes so often.
    """

    head_within_s = 10.0
    _ends: asyncio.TimerHandle | None = None
    _in_head, _head_bytes, _unparsed_bytes, _refused = True, 0, 0, False

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begins to wait for the first request."""
        super().connection_made(transport)
        self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Waits for nothing more."""
        self._wait_no_more()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Takes in what came; uvicorn has stopped its own timer by then, also for a byte that begins no request.

        The parser collects a header without end, be it of a head or after a body, and nobody sees it before it has one: what came
        without being seen is counted.
        """
        if self._refused:
            return
        self._unparsed_bytes += len(data)
        super().data_received(data)
        if self._refused:
            return
        if self._unparsed_bytes > MOST_HEAD_BYTES:
            self._refuse()
            return
        is_asked = self.cycle is not None and not self.cycle.response_complete
        has_left = self.transport.is_closing() or self.transport.get_protocol() is not self
        if self._ends is None and not is_asked and not has_left:
            self._wait()

    def on_message_begin(self) -> None:
        """A head begins."""
        self._in_head, self._head_bytes = True, 0
        super().on_message_begin()

    def on_url(self, url: bytes) -> None:
        """Takes in a part of the address."""
        self._count(len(url))
        super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        """Takes in a header."""
        self._count(len(name) + len(value) + len(b": \r\n"))
        if not self._in_head:  # after a body, where nobody looks for any
            return
        super().on_header(name, value)
        if len(self.headers) > MOST_HEADERS:
            self._refuse()
            raise HeadTooLarge

    def on_headers_complete(self) -> None:
        """The head is there: what follows has limits of its own."""
        if len(self.pipeline) >= MOST_PIPELINED:
            self._refuse()
            raise HeadTooLarge
        self._wait_no_more()
        self._in_head, self._unparsed_bytes = False, 0
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        """What comes next is a head."""
        self._in_head, self._unparsed_bytes = True, 0
        super().on_message_complete()

    def send_400_response(self, msg: str) -> None:
        """Answers what cannot be parsed; what was refused has its answer."""
        if not self._refused:
            super().send_400_response(msg)

    def _count(self, size: int) -> None:
        self._head_bytes += size
        if self._head_bytes > MOST_HEAD_BYTES:
            self._refuse()
            raise HeadTooLarge

    def _refuse(self) -> None:
        self._refused = True
        self._wait_no_more()
        self.transport.write(_TOO_LARGE)
        self.transport.close()

    def on_body(self, body: bytes) -> None:
        """Takes in a part of a body."""
        self._unparsed_bytes = 0
        self._wait_no_more()  # begins again with the end of ``data_received`` where the request was answered already
        super().on_body(body)

    def _wait(self) -> None:
        self._ends = self.loop.call_later(self.head_within_s, self.timeout_keep_alive_handler)

    def _wait_no_more(self) -> None:
        if self._ends is not None:
            self._ends.cancel()
            self._ends = None


def _too_large() -> bytes:
    detail = f"A head may have {MOST_HEAD_BYTES} bytes in {MOST_HEADERS} headers, and {MOST_PIPELINED} requests may wait on one."
    slug = "head-too-large"
    said = {"type": f"/problems/{slug}", "title": "Head too large", "status": 431, "detail": detail}
    body = json.dumps(said).encode()
    lines = (
        b"HTTP/1.1 431 Request Header Fields Too Large",
        b"content-type: application/problem+json",
        b"content-length: %d" % len(body),
        b"connection: close",
    )
    return b"\r\n".join((*lines, b"", body))


_TOO_LARGE = _too_large()


def connection(head_within_s: float) -> type[Connection]:
    """The class of connections on which the head of a request must come within ``head_within_s``, in seconds."""
    return type("Connection", (Connection,), {"head_within_s": head_within_s})
