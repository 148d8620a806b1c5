"""What a farm calls and what it never does, with real servers on this machine."""

import asyncio
import socket
import ssl
import threading
from dataclasses import replace

import pytest

from api_schemas.job import JobRequest
from services.webhooks.address import ASKED_AT_ONCE, Resolver, is_public
from services.webhooks.calling import NO_ANSWER, FailedError, Reach, RefusedError, call
from tests.integration.farm_process import PATIENCE_S, until

PUBLIC = ["93.184.216.34", "8.8.8.8", "2606:2800:220:1:248:1893:25c8:1946", "64:ff9b::808:808"]
OWN = [
    "127.0.0.1", "127.1.2.3", "0.0.0.0", "10.1.2.3", "172.16.0.1", "172.31.255.255", "192.168.1.1", "169.254.169.254",
    "100.64.0.1", "198.18.0.1", "192.0.0.8", "224.0.0.1", "240.0.0.1", "255.255.255.255", "::", "::1", "::127.0.0.1",
    "fe80::1", "fe80::1%eth0", "fc00::1", "fd00:ec2::254", "fec0::1", "ff02::1", "::ffff:8.8.8.8", "::ffff:127.0.0.1",
    "::ffff:10.0.0.1", "64:ff9b::7f00:1", "64:ff9b::a9fe:a9fe", "64:ff9b:1::1", "2002:7f00:1::1", "2002:a00:1::",
    "2001:0:7f00:1::", "2001:db8::1", "localhost", "",
]  # fmt: skip


@pytest.mark.parametrize("address", PUBLIC)
def test_public_addresses_may_be_called(address):
    assert is_public(address)


@pytest.mark.parametrize("address", OWN)
def test_addresses_of_this_machine_and_its_networks_may_not(address):
    assert not is_public(address)


@pytest.mark.parametrize("host", ["a.example", "a.example:443", "a.example:8443", "[2606:2800:220:1::1]:8443"])
def test_the_ports_of_https_may_be_called(host):
    wish = JobRequest.model_validate({"policy": "0" * 64, "task": "push", "webhook": f"https://{host}/x"})
    assert wish.webhook == f"https://{host}/x"


@pytest.mark.parametrize(
    "url",
    [
        "http://a.example/",
        "https:///x",
        "https://u:p@a.example/",
        "https://a.example/\r\nHost: b",
        "https://a.example/ü",
        "ftp://a.example",
        "https://a.example/" + "x" * 500,
        "https://a.example\\@b.example/",
        "https://a.example:0/",
        "https://a.example:22/",
        "https://a.example:8080/",
        "https://a.example:99999/",
        "javascript:1",
    ],
)
def test_other_addresses_are_refused_when_a_job_is_sent(url):
    with pytest.raises(ValueError):
        JobRequest.model_validate({"policy": "0" * 64, "task": "push", "webhook": url})


async def test_a_call_brings_the_body_to_the_host_that_was_named(receiving, here):
    async with receiving() as receiver:
        assert await call(receiver.url, {"X-Mine": "1"}, b'{"a":1}', here) == 204
    (request,) = receiver.requests
    head, _, body = request.partition(b"\r\n\r\n")
    assert head.startswith(b"POST /hook?of=mine HTTP/1.1\r\nHost: receiver.example.org:")
    assert b"X-Mine: 1" in head and body == b'{"a":1}'


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "[::1]", "[::ffff:127.0.0.1]", "2130706433", "0x7f.1", "127.1"])
async def test_no_spelling_of_this_machine_is_called(receiving, certificate, host):
    async with receiving() as receiver:
        reach = Reach(trusted=ssl.create_default_context(cafile=certificate))  # as a farm has it, but for whom it trusts
        with pytest.raises(FailedError) as failed:
            await call(f"https://{host}:{receiver.port}/", {}, b"{}", reach)
        assert str(failed.value) == NO_ANSWER
        assert failed.value.why.startswith(("the host is not on the public Internet", "the host could not be reached"))
        assert receiver.connections == 0


async def test_a_name_is_asked_for_once_and_what_was_checked_is_connected_to(receiving, here):
    asked = []

    async def rebinding(host, port):
        """First an address that passes, then this machine: as a name server that wants in would answer."""
        asked.append((host, port))
        return ["192.0.2.1"] if len(asked) == 1 else ["127.0.0.1"]

    async with receiving() as receiver:
        reach = replace(here, resolve=rebinding, may_call=lambda address: address == "192.0.2.1", within_s=0.3)
        with pytest.raises(FailedError):
            await call(receiver.url, {}, b"{}", reach)
        assert receiver.connections == 0
    assert len(asked) == 1


async def test_one_bad_address_among_good_ones_is_enough_to_refuse(receiving, here):
    async def both(_host, _port):
        return ["93.184.216.34", "127.0.0.1"]

    async with receiving() as receiver:
        with pytest.raises(FailedError) as failed:
            await call(receiver.url, {}, b"{}", replace(here, resolve=both, may_call=is_public))
        assert (str(failed.value), failed.value.why.partition(";")[0]) == (NO_ANSWER, "the host is not on the public Internet")
        assert receiver.connections == 0


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
async def test_redirects_are_not_followed(receiving, here, status):
    async with receiving() as inner, receiving() as receiver:
        receiver.answer = f"HTTP/1.1 {status} Moved\r\nLocation: https://127.0.0.1:{inner.port}/\r\n\r\n".encode()
        with pytest.raises(RefusedError, match=f"answered {status}; redirects are not followed"):
            await call(receiver.url, {}, b"{}", here)
        assert inner.connections == 0


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"HTTP/1.1 500 Oops\r\n\r\n", "answered 500"),
        (b"HTTP/1.1 404 Not Found\r\n\r\n", "answered 404"),
        (b"SSH-2.0-OpenSSH\r\n", "the connection failed"),
        (b"HTTP/1.1 " + b"2" * 5000, "the connection failed"),
        (b"", "the connection failed"),
        (None, "no answer within 0.5 s"),
    ],
)
async def test_what_is_no_success_is_said(receiving, here, answer, words):
    async with receiving(answer=answer) as receiver:
        with pytest.raises(FailedError) as failed:
            await call(receiver.url, {}, b"{}", replace(here, within_s=0.5 if answer is None else 120.0))
    assert failed.value.why == words
    assert str(failed.value) == (words if words.startswith("answered") else NO_ANSWER)


async def test_a_host_whose_certificate_is_another_ones_is_not_told_anything(receiving, here):
    async with receiving() as receiver:
        for reach, host in (
            (replace(here, trusted=ssl.create_default_context()), "receiver.example.org"),
            (here, "other.example.org"),
        ):
            with pytest.raises(FailedError) as failed:
                await call(f"https://{host}:{receiver.port}/", {}, b"{}", reach)
            assert (str(failed.value), failed.value.why) == (NO_ANSWER, "the certificate is not valid for the host")
        assert receiver.requests == []


async def test_a_host_that_is_slow_to_connect_ends_in_time(here):
    async def never(_host, _port):
        await asyncio.sleep(300)
        return []

    with pytest.raises(FailedError) as failed:
        await call("https://a.example/", {}, b"{}", replace(here, resolve=never, within_s=0.2))
    assert (str(failed.value), failed.value.why) == (NO_ANSWER, "no answer within 0.2 s")


async def test_a_name_without_an_address_has_none():
    assert await Resolver()("no-such-host.invalid", 443) == []


async def test_slow_name_servers_hold_up_nothing_else(monkeypatch):
    answered = threading.Event()

    def slow(*_asked, **_more):
        answered.wait(300)
        return []

    def resolving():
        return [each for each in threading.enumerate() if each.name == "resolver"]

    monkeypatch.setattr(socket, "getaddrinfo", slow)
    resolver = Resolver()
    try:
        asking = [asyncio.create_task(resolver(f"{number}.example", 443)) for number in range(ASKED_AT_ONCE + 10)]
        await asyncio.to_thread(until, lambda: len(resolving()) >= ASKED_AT_ONCE, PATIENCE_S, "threads that ask")
        await asyncio.sleep(0.1)
        assert len(resolving()) == ASKED_AT_ONCE and all(each.daemon for each in resolving())
        assert await asyncio.wait_for(asyncio.to_thread(lambda: "a file was read"), 120) == "a file was read"
        asking[0].cancel()
    finally:
        answered.set()
    assert await asyncio.wait_for(asyncio.gather(*asking[1:]), 120) == [[]] * (ASKED_AT_ONCE + 9)


async def test_what_calls_left_behind_at_slow_name_servers_keeps_no_other_call_waiting(monkeypatch):
    """Eight calls at once of 10 s each, whose hosts are answered for after a minute: what anybody can have the farm ask for."""
    answered, ask = threading.Event(), socket.getaddrinfo

    def slow(host, *asked, **more):
        if host.startswith("slow"):
            answered.wait(300)
            return []
        return ask("127.0.0.1", *asked, **more)

    monkeypatch.setattr(socket, "getaddrinfo", slow)
    resolver = Resolver()
    try:
        left = [asyncio.create_task(resolver(f"slow{number}.example", 443)) for number in range(8 * 60 // 10)]
        await asyncio.sleep(0)
        for each in left:
            each.cancel()
        assert await asyncio.wait_for(resolver("quick.example", 443), PATIENCE_S) == ["127.0.0.1"]
    finally:
        answered.set()
