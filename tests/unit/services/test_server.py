"""A server that closes ends the connections of busy clients, too."""

import asyncio

import uvicorn

from services.server import Server


async def test_a_connection_that_comes_while_the_server_closes_is_ended_too():
    server = Server(uvicorn.Config(lambda *_: None, timeout_graceful_shutdown=20, lifespan="off"), handshake_within_s=1.0)
    server.config.load()
    server.lifespan, server.servers = server.config.lifespan_class(server.config), []
    connections = server.server_state.connections

    class Late:
        def shutdown(self):
            connections.discard(self)

    stopping = asyncio.create_task(server.shutdown())
    await asyncio.sleep(0.02)
    connections.add(Late())
    await asyncio.wait_for(stopping, 5.0)
    assert not connections
