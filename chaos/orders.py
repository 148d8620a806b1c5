"""Orders to processes of a broken farm: a file that one of them takes, once, when it comes to the named place."""

import os
import signal
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Orders:
    """The orders of one folder."""

    evidence: Path

    def give(self, order: str, who: str = "any") -> None:
        """Leaves an order; who it is for takes it at the next occasion."""
        self._path(order, who).touch()

    def take(self, order: str, who: str = "any") -> bool:
        """Whether there was such an order; of several processes one alone has it."""
        try:
            self._path(order, who).unlink()
        except FileNotFoundError:
            return False
        return True

    def stands(self, order: str, who: str = "any") -> bool:
        """Whether nobody has taken it yet."""
        return self._path(order, who).exists()

    def die_here(self, place: str) -> None:
        """Ends this process on the spot, as kill -9 does, if that was ordered for this place."""
        if self.take(f"die-{place}"):
            os.kill(os.getpid(), signal.SIGKILL)

    def _path(self, order: str, who: str) -> Path:
        return self.evidence / f"{order}.{who}.order"
