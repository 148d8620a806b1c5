"""A connection that becomes another protocol's is left alone."""

import asyncio

import uvicorn
from uvicorn.server import ServerState

from services.connection import connection

HEAD_S = 0.2
UPGRADE = b"GET / HTTP/1.1\r\nHost: farm\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\r\n"


class Echo(asyncio.Protocol):
    """What uvicorn hands a connection over to, in the place of a library for websockets."""

    def __init__(self, config, server_state, app_state):
        self.transport: asyncio.Transport

    def connection_made(self, transport):
        self.transport = transport

    def data_received(self, data):
        self.transport.write(data)


async def nothing(_scope, _receive, _send):
    raise AssertionError("no request is answered here")


async def test_an_upgraded_connection_lives_on():
    config = uvicorn.Config(nothing, ws=Echo, lifespan="off", log_config=None)
    config.load()
    state, made = ServerState(), connection(HEAD_S)
    server = await asyncio.get_running_loop().create_server(lambda: made(config, state, {}), "127.0.0.1", 0)
    async with server:
        reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        writer.write(UPGRADE)
        assert await reader.readuntil(b"\r\n\r\n")
        await asyncio.sleep(4 * HEAD_S)
        writer.write(b"still here")
        assert await asyncio.wait_for(reader.readexactly(10), 120) == b"still here"
        writer.close()
