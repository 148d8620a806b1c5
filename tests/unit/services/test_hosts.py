"""Which names the services answer to, and what they say of https."""

import asyncio

import pytest

from services.hosts import Hosts, allowed_hosts
from services.settings import Settings


def asked(allowed, host, scheme="http"):
    """Status and headers of the answer to a request with this Host."""
    sent = []

    async def app(_scope, _receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message):
        sent.append(message)

    headers = [] if host is None else [(b"host", host.encode())]
    asyncio.run(Hosts(app, allowed)({"type": "http", "scheme": scheme, "headers": headers}, None, send))
    return sent[0]["status"], dict(sent[0]["headers"])


@pytest.mark.parametrize(
    ("settings", "good", "bad"),
    [
        (
            {},
            ("localhost", "127.0.0.1:8787", "[::1]:8787", "LOCALHOST:1"),
            ("farm", "127.0.0.1.evil.example", ""),
        ),
        ({"hosts": "farm.example.org, [::1]"}, ("farm.example.org:443", "[::1]"), ("localhost", "example.org")),
        ({"host": "0.0.0.0"}, ("anything",), ()),
        ({"trusted_proxies": "127.0.0.1"}, ("farm.example.org",), ()),
    ],
)
def test_names_that_are_answered_to(settings, good, bad):
    allowed = allowed_hosts(Settings(**settings))
    assert [asked(allowed, host)[0] for host in good] == [200] * len(good)
    assert [asked(allowed, host)[0] for host in bad] == [421] * len(bad)
    assert asked(allowed, None)[0] == 200, "of HTTP/1.0, which no browser speaks"


def test_over_https_a_name_is_never_asked_over_http_again():
    assert b"strict-transport-security" in asked(None, "farm.example.org", "https")[1]
    for host, scheme in (("farm.example.org", "http"), ("localhost:8787", "https"), ("10.0.0.1", "https"), ("[::1]", "https")):
        assert b"strict-transport-security" not in asked(None, host, scheme)[1], (host, scheme)
