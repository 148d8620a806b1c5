"""The names under which the services may be asked: a page of another site must not reach them by a name of its own.

A browser sends a page's script to wherever the name of its site leads. A site whose name is said to be 127.0.0.1 (DNS
rebinding) gets to services on the reader's own machine, but with its own name in ``Host``.
"""

import ipaddress
import json

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.settings import Settings

HERE = frozenset({"localhost", "127.0.0.1", "::1"})
HSTS = b"max-age=31536000"
"""A browser that has seen the farm over https asks it by nothing else for a year (RFC 6797)."""


def allowed_hosts(settings: Settings) -> frozenset[str] | None:
    """The names that are answered to; None for any.

    Without a list, services that listen on loopback alone, with no proxy before them, answer to the names of loopback.
    """
    if settings.hosts is not None:
        return frozenset(each.strip().lower().strip("[]") for each in settings.hosts.split(",") if each.strip())
    if settings.host in HERE and settings.trusted_proxies is None:
        return HERE
    return None


class Hosts:
    """The application behind a look at ``Host``; over https, answers have HSTS where their host has a name."""

    def __init__(self, app: ASGIApp, allowed: frozenset[str] | None) -> None:
        self._app, self._allowed = app, allowed

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        host = _host(scope)
        if self._allowed is not None and host is not None and host not in self._allowed:
            await _misdirected(host, send)
            return
        await self._app(scope, receive, _strict(send) if scope["scheme"] == "https" and _is_name(host) else send)


def _host(scope: Scope) -> str | None:
    for name, value in scope["headers"]:
        if name == b"host":
            text = value.decode("latin-1").strip().lower()
            return text[1:].partition("]")[0] if text.startswith("[") else text.partition(":")[0]
    return None


def _is_name(host: str | None) -> bool:
    if not host or host == "localhost":  # other servers of this machine have that name, too
        return False
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return True
    return False


def _strict(send: Send) -> Send:
    async def strictly(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), (b"strict-transport-security", HSTS)]
        await send(message)

    return strictly


async def _misdirected(host: str, send: Send) -> None:
    detail = f"The services do not answer to the host {host[:100]!r}; TRIFARM_HOSTS lists the names that they have."
    slug = "host-unknown"
    body = json.dumps({"type": f"/problems/{slug}", "title": "Misdirected request", "status": 421, "detail": detail}).encode()
    headers = [(b"content-type", b"application/problem+json"), (b"content-length", b"%d" % len(body)), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": 421, "headers": headers})
    await send({"type": "http.response.body", "body": body})
