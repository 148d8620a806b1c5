"""Which addresses may be called: those of the public Internet, however they are written."""

import asyncio
import ipaddress
import socket
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
NAT64 = ipaddress.ip_network("64:ff9b::/96")
SPECIAL = tuple(
    ipaddress.ip_network(each) for each in ("64:ff9b:1::/48", "192.0.0.0/24", "192.88.99.0/24", "3fff::/20", "5f00::/16")
)
"""Of special use by IANA's registries, and not known as such to every version of Python."""
ASKED_AT_ONCE = 64
"""Hosts that are asked for at the same time. An answer may take longer than the call that it is for waits, and the next call is
made meanwhile: of name servers that let each question take a minute, eight calls of 10 s leave 48 behind."""


def is_public(text: str) -> bool:
    """Whether an address, and each that is written inside it, is one of the public Internet."""
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return False  # also one with a zone, which only makes sense on a link of this machine
    return all(_is_global(each) for each in (address, *_inside(address)))


def _is_global(address: Address) -> bool:
    if isinstance(address, ipaddress.IPv6Address) and address.is_site_local:
        return False
    if any(address in network for network in SPECIAL):
        return False
    return address.is_global and not address.is_multicast and (address in NAT64 or not address.is_reserved)


def _inside(address: Address) -> Iterator[Address]:
    """The IPv4 addresses that an IPv6 address stands for."""
    if isinstance(address, ipaddress.IPv4Address):
        return
    if address.ipv4_mapped is not None:
        yield address.ipv4_mapped
    if address.sixtofour is not None:
        yield address.sixtofour
    if address.teredo is not None:
        yield from address.teredo
    if address in NAT64:
        yield ipaddress.IPv4Address(int(address) & 0xFFFFFFFF)


@dataclass(frozen=True)
class Resolver:
    """Asks for the addresses of hosts on threads of its own, which the process's end does not wait for.

    The threads that asyncio lends are the ones that files are read and written on, and name servers are other people's: one that
    is slow must stop nothing but the calls that it was asked for.
    """

    _free: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(ASKED_AT_ONCE))

    async def __call__(self, host: str, port: int) -> list[str]:
        """The addresses of a host, in the resolver's order; none where it has none."""
        loop, answer = asyncio.get_running_loop(), asyncio.get_running_loop().create_future()

        def tell(found: list[str]) -> None:
            self._free.release()
            if not answer.done():
                answer.set_result(found)

        def ask() -> None:
            found = _ask(host, port)
            with suppress(RuntimeError):  # the loop has ended meanwhile, and nobody waits
                loop.call_soon_threadsafe(tell, found)

        await self._free.acquire()
        threading.Thread(target=ask, name="resolver", daemon=True).start()
        return await answer


def _ask(host: str, port: int) -> list[str]:
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return []
    return list(dict.fromkeys(str(each[4][0]) for each in found))
