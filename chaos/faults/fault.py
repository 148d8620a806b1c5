"""What a fault is, and what it works on."""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass

from chaos import history
from chaos.clients import Clients
from chaos.farm import Farm
from chaos.history import Line
from chaos.isolation import Isolation
from chaos.processes import until

READY_WITHIN_S = 180.0


@dataclass(frozen=True)
class Scene:
    """A farm at work. ``quick`` shortens what lasts, ``rng`` chooses whom it hits."""

    farm: Farm
    clients: Clients
    rng: random.Random
    isolation: Isolation
    quick: bool

    def lasting(self, full_s: float, quick_s: float) -> float:
        """How long a fault lasts."""
        return quick_s if self.quick else full_s

    def whole_again(self) -> None:
        """Waits until the API answers and all robots are in service."""
        self.clients.check()
        self.farm.ready_api(READY_WITHIN_S)
        self.farm.ready_robots(READY_WITHIN_S)

    def lines_since(self, since_s: float) -> list[Line]:
        """What all have done since then."""
        return [line for line in history.read(self.farm.evidence) if line.at_s >= since_s]

    def wait_for_line(self, since_s: float, is_it: Callable[[Line], bool], within_s: float, what: str) -> Line:
        """The first line since then that is the wanted one."""
        found: list[Line] = []

        def look() -> bool:
            found.extend(line for line in self.lines_since(since_s) if is_it(line))
            return bool(found)

        until(look, within_s, what, every_s=0.5)
        return found[0]


@dataclass(frozen=True)
class Fault:
    """One kind of fault.

    Args:
        name: what it is called.
        what: what happens.
        inject: does it; gives what was seen of it. It raises ``DidNotHappen`` when nothing was.
        missing: why it cannot be done here, or None.
    """

    name: str
    what: str
    inject: Callable[[Scene], str]
    missing: Callable[[Scene], str | None] = lambda _: None


@dataclass(frozen=True)
class Injection:
    """What became of one fault."""

    fault: str
    injected: int
    verified: bool
    seen: str | None = None
    skipped_because: str | None = None


def now_s() -> float:
    """The clock of the histories."""
    return time.monotonic()


def needs_isolation(scene: Scene) -> str | None:
    """Why there is no disk or network of our own, or None."""
    return scene.isolation.why_not


def needs_servers(scene: Scene) -> str | None:
    """Why there is no database server or file server to break, or None."""
    return None if scene.farm.home is not None else "this home has no servers of its own; --home scale has"
