"""What stands between clients and the API, and cuts connections: after a request went through, before its answer comes back."""

import asyncio
from contextlib import suppress

READ_BYTES = 65_536


class Relay:
    """Carries bytes between clients and one API on loopback. Owner of the count of answers that are still to be cut."""

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._to_cut = 0
        self.cuts = 0
        """How many answers were cut."""
        self._server: asyncio.Server | None = None
        self._carrying: set[asyncio.Task[None]] = set()

    async def open(self) -> str:
        """Listens; gives the address that clients are to ask."""
        self._server = await asyncio.start_server(self._begin, self._host, 0)
        port = self._server.sockets[0].getsockname()[1]
        return f"http://{self._host}:{port}"

    def cut(self, answers: int) -> None:
        """Cuts off so many of the next answers to submissions."""
        self._to_cut += answers

    def close(self) -> None:
        """Stops listening."""
        if self._server is not None:
            self._server.close()
        for each in self._carrying:
            each.cancel()

    def _begin(self, client: asyncio.StreamReader, to_client: asyncio.StreamWriter) -> None:
        carrying = asyncio.get_running_loop().create_task(self._carry(client, to_client))
        self._carrying.add(carrying)
        carrying.add_done_callback(self._carrying.discard)

    async def _carry(self, client: asyncio.StreamReader, to_client: asyncio.StreamWriter) -> None:
        try:
            api, to_api = await asyncio.open_connection(self._host, self._port)
        except OSError:
            to_client.transport.abort()
            return
        asked = asyncio.create_task(self._ask(client, to_api))
        try:
            while answer := await api.read(READ_BYTES):
                if self._to_cut > 0 and getattr(to_api, "submits", False):
                    self._to_cut, self.cuts = self._to_cut - 1, self.cuts + 1
                    break
                to_client.write(answer)
                await to_client.drain()
        except (OSError, asyncio.CancelledError):
            pass  # the one who reads, or the run, is gone
        finally:
            asked.cancel()
            for each in (to_api, to_client):
                with suppress(OSError):
                    each.transport.abort()

    @staticmethod
    async def _ask(client: asyncio.StreamReader, to_api: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while asked := await client.read(READ_BYTES):
                to_api.submits = asked.startswith(b"POST /v1/jobs ")  # pyrefly: ignore[missing-attribute]
                to_api.write(asked)
                await to_api.drain()
            to_api.write_eof()
