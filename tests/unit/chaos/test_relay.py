"""The relay cuts an answer after its request went through, and no other."""

import asyncio

import httpx
import pytest

from chaos.relay import Relay


@pytest.fixture
async def farm():
    """A server that counts what it is asked, and a relay before it."""
    asked = []

    async def serve(reader, writer):
        head = await reader.readuntil(b"\r\n\r\n")
        asked.append(head.split(b" HTTP", 1)[0].decode())
        writer.write(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\nConnection: close\r\n\r\nok")
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    relay = Relay("127.0.0.1", server.sockets[0].getsockname()[1])
    async with httpx.AsyncClient(base_url=await relay.open(), trust_env=False) as client:
        yield relay, client, asked
    relay.close()
    server.close()


async def test_an_answer_is_cut_once_and_the_request_was_heard(farm):
    relay, client, asked = farm
    relay.cut(1)
    assert (await client.get("/v1/jobs")).text == "ok"  # only answers to submissions are cut
    with pytest.raises(httpx.TransportError):
        await client.post("/v1/jobs")
    assert (await client.post("/v1/jobs")).text == "ok"
    assert asked == ["GET /v1/jobs", "POST /v1/jobs", "POST /v1/jobs"]
    assert relay.cuts == 1


async def test_a_client_meets_a_reset_where_no_server_is(farm):
    relay, client, _ = farm
    relay._port = 1
    with pytest.raises(httpx.TransportError):
        await client.get("/v1/jobs")
