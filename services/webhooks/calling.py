"""One call of a webhook: resolved once, checked, and then connected to the very address that was checked.

Written on sockets, not on an HTTP library, so that between the check and the connection nobody asks for the address again, no
proxy of the environment stands between, no redirect is followed, and of the answer nothing but its first line is read.
"""

import asyncio
import ssl
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from services.webhooks.address import Resolver, is_public

WITHIN_S = 10.0
HTTPS = 443
NO_ANSWER = "no HTTP answer; the host must be on the public Internet, answer in 10 s, and have a certificate of its name"
"""All that is said where there was no answer: why there was none would tell what is in the farm's own network."""
LONGEST_LINE = 1024
"""Bytes of an answer's first line."""


class RefusedError(Exception):
    """The answer says that the address leads elsewhere; no other try follows."""


class FailedError(Exception):
    """The call did not succeed, another try may: the message is for the job's owner, ``why`` for the farm's operator alone."""

    def __init__(self, message: str, why: str) -> None:
        super().__init__(message)
        self.why = why


@dataclass(frozen=True)
class Reach:
    """What may be called and how; parts of it are others in tests only."""

    resolve: Callable[[str, int], Awaitable[list[str]]] = field(default_factory=Resolver)
    may_call: Callable[[str], bool] = is_public
    trusted: ssl.SSLContext = field(default_factory=ssl.create_default_context)
    within_s: float = WITHIN_S


async def call(url: str, headers: Mapping[str, str], body: bytes, reach: Reach) -> int:
    """Posts the body; gives the status of the answer, which is a success.

    Raises:
        RefusedError: the address leads elsewhere.
        FailedError: it is none that may be called, no answer came in time, or one that is no success.
    """
    parts = urlsplit(url)
    host, port = parts.hostname or "", parts.port or HTTPS
    try:
        async with asyncio.timeout(reach.within_s):
            address = await _address(host, port, reach)
            status = await _post(address, host, port, _request(parts.netloc, _target(url), headers, body), reach.trusted)
    except TimeoutError as error:
        raise FailedError(NO_ANSWER, f"no answer within {reach.within_s:g} s") from error
    except ssl.SSLCertVerificationError as error:
        raise FailedError(NO_ANSWER, "the certificate is not valid for the host") from error
    except (OSError, asyncio.IncompleteReadError, ValueError) as error:
        raise FailedError(NO_ANSWER, "the connection failed") from error
    if 300 <= status < 400:
        raise RefusedError(f"answered {status}; redirects are not followed")
    if not 200 <= status < 300:
        raise FailedError(f"answered {status}", f"answered {status}")
    return status


async def _address(host: str, port: int, reach: Reach) -> str:
    """The address to connect to, if all that the host has may be called."""
    found = await reach.resolve(host, port)
    if not found:
        raise FailedError(NO_ANSWER, "the host could not be reached")
    if not all(reach.may_call(each) for each in found):
        raise FailedError(NO_ANSWER, "the host is not on the public Internet; others are not called")
    return found[0]


async def _post(address: str, host: str, port: int, request: bytes, trusted: ssl.SSLContext) -> int:
    reader, writer = await asyncio.open_connection(address, port, ssl=trusted, server_hostname=host, limit=LONGEST_LINE)
    try:
        writer.write(request)
        await writer.drain()
        return _status(await reader.readuntil(b"\n"))
    except asyncio.LimitOverrunError as error:
        raise ValueError("the answer is not HTTP") from error
    finally:
        writer.transport.abort()


def _status(line: bytes) -> int:
    version, _, rest = line.partition(b" ")
    if not version.startswith(b"HTTP/1.") or not rest[:3].isdigit():
        raise ValueError("the answer is not HTTP")
    return int(rest[:3])


def _target(url: str) -> str:
    """Path and query, as a request names them."""
    parts = urlsplit(url)
    return (parts.path or "/") + (f"?{parts.query}" if parts.query else "")


def _request(host: str, target: str, headers: Mapping[str, str], body: bytes) -> bytes:
    lines = [f"POST {target} HTTP/1.1", f"Host: {host}", f"Content-Length: {len(body)}", "Connection: close"]
    lines += ["Content-Type: application/json", "User-Agent: trifarm", *(f"{name}: {value}" for name, value in headers.items())]
    return "\r\n".join([*lines, "", ""]).encode("ascii") + body
