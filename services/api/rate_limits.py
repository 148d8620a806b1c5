"""How often one may ask: a bucket of requests for each token and for each address without one, refilled steadily."""

import ipaddress
import math
from collections import OrderedDict
from dataclasses import dataclass, field

BURST_S = 10.0
"""A bucket that nobody draws from holds what comes in this time."""
MOST_BUCKETS = 10_000
"""Beyond that the buckets that were longest left alone are forgotten, which are full or nearly so."""
IPV6_PREFIX = 64
"""One household or one virtual machine has as many addresses as share these bits."""


@dataclass(frozen=True)
class Draw:
    """What came of a request: whether it may pass, how many more may now, and after how long the next one."""

    passes: bool
    left: int
    wait_s: float


def drawn(left: float, passed_s: float, per_s: float) -> tuple[float, Draw]:
    """A request at a bucket that held ``left`` ``passed_s`` ago; gives what it holds then, and what comes of it."""
    now = min(per_s * BURST_S, left + passed_s * per_s)
    if now < 1.0:
        return now, Draw(False, 0, (1.0 - now) / per_s)
    return now - 1.0, Draw(True, int(now - 1.0), 0.0)


@dataclass
class Buckets:
    """Buckets of one kind by name; owner of what they hold. ``per_s`` 0 lets everything pass."""

    per_s: float
    _held: OrderedDict[str, tuple[float, float]] = field(default_factory=OrderedDict)

    def draw(self, name: str, now_s: float) -> Draw:
        """Takes one request out of the bucket, if it has one; ``now_s`` must never go back."""
        if self.per_s == 0:
            return Draw(True, 0, 0.0)
        left, then_s = self._held.pop(name, (self.per_s * BURST_S, now_s))
        left, draw = drawn(left, now_s - then_s, self.per_s)
        self._held[name] = (left, now_s)
        if len(self._held) > MOST_BUCKETS:
            self._held.popitem(last=False)
        return draw

    def give_back(self, name: str) -> None:
        """Puts back one request that was drawn for nothing."""
        if (held := self._held.get(name)) is not None:
            self._held[name] = (held[0] + 1.0, held[1])

    def policy(self) -> str:
        """The RateLimit-Policy of these buckets (IETF draft-ietf-httpapi-ratelimit-headers)."""
        return f'"requests";q={math.floor(self.per_s * BURST_S)};w={BURST_S:.0f}'


def network(address: str) -> str:
    """What an address counts as: itself, or for IPv6 the network that its owner was given."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address
    if parsed.version == 4:
        return address
    if parsed.ipv4_mapped is not None:
        return str(parsed.ipv4_mapped)
    return str(ipaddress.ip_network((parsed, IPV6_PREFIX), strict=False))
