"""How often one may ask: a bucket of requests for each token and for each address without one, refilled steadily."""

import ipaddress
import math
from collections import Counter, OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field

from services.settings import Settings

BURST_S = 10.0
"""A bucket that nobody draws from holds what comes in this time."""
MOST_BUCKETS = 10_000
"""Beyond that the buckets that were longest left alone are forgotten, which are full or nearly so."""
MOST_TOLD, WORTH_S = 500, 0.05
"""Of one kind, other processes are told of so many at most, and of nobody who drew less than comes in within this time."""
IPV6_PREFIX = 64
"""One household or one virtual machine has as many addresses as share these bits."""


@dataclass(frozen=True)
class Limits:
    """The buckets of one process: of addresses without a known token, of users' tokens and of robots'."""

    anonymous: "Buckets"
    users: "Buckets"
    robots: "Buckets"

    @classmethod
    def of(cls, settings: Settings) -> "Limits":
        """As the settings say."""
        rates = (settings.anonymous_requests_per_s, settings.requests_per_s, settings.robot_requests_per_s)
        return cls(*(Buckets(per_s, shared=settings.database_url is not None) for per_s in rates))

    def by_kind(self) -> dict[str, "Buckets"]:
        """The kinds, by the names that other processes know them by."""
        return {"address": self.anonymous, "token": self.users, "robot": self.robots}


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
    """Buckets of one kind by name; owner of what they hold. ``per_s`` 0 lets everything pass.

    Several processes that serve one farm have buckets of their own and tell each other what was drawn (``tell``, ``hear``).
    """

    per_s: float
    shared: bool = False
    _held: OrderedDict[str, tuple[float, float]] = field(default_factory=OrderedDict)
    _drawn: Counter[str] = field(default_factory=Counter)
    _heard: dict[str, tuple[int, float]] = field(default_factory=dict)

    def draw(self, name: str, now_s: float) -> Draw:
        """Takes one request out of the bucket, if it has one; ``now_s`` must never go back."""
        if self.per_s == 0:
            return Draw(True, 0, 0.0)
        left, then_s = self._held.pop(name, (self.per_s * BURST_S, now_s))
        left, draw = drawn(left, now_s - then_s, self.per_s)
        if self.shared and (name in self._drawn or len(self._drawn) < MOST_BUCKETS):
            self._drawn[name] += int(draw.passes)
        self._held[name] = (left, now_s)
        if len(self._held) > MOST_BUCKETS:
            self._held.popitem(last=False)
        return draw

    def give_back(self, name: str) -> None:
        """Puts back one request that was drawn for nothing."""
        if (held := self._held.get(name)) is not None:
            self._held[name] = (held[0] + 1.0, held[1])
            self._drawn[name] -= int(name in self._drawn)

    def tell(self) -> dict[str, int]:
        """What was drawn since this was last asked, of those who asked for a share of their limit that is worth the telling."""
        told = {name: count for name, count in self._drawn.most_common(MOST_TOLD) if count > WORTH_S * self.per_s}
        self._drawn = Counter()
        return told

    def hear(self, told: Mapping[str, int], totals: Mapping[str, int], now_s: float) -> None:
        """Takes out what others have let pass.

        Args:
            told: what was told from here.
            totals: how often each has asked anywhere, these times among them.
            now_s: as in ``draw``.
        """
        for name, total in totals.items():
            before, at_s = self._heard.get(name, (total - told.get(name, 0), now_s))
            elsewhere = total - told.get(name, 0) - before
            self._heard[name] = (total, now_s)
            if elsewhere > 0 and now_s - at_s < BURST_S and (held := self._held.get(name)) is not None:
                self._held[name] = (max(-self.per_s * BURST_S, held[0] - elsewhere), held[1])
        self._heard = {name: heard for name, heard in self._heard.items() if now_s - heard[1] < BURST_S}

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
