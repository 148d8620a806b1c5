"""The disk of the data folder: below a reserve nothing new is accepted, so that what was accepted can be finished."""

from dataclasses import dataclass
from pathlib import Path

from services.errors import Unavailable
from trial_logs.disk import mb, room


@dataclass(frozen=True)
class Disk:
    """Where one services process keeps database and files, or gathers uploads; ``reserve_bytes`` is kept for finishing."""

    folder: Path
    reserve_bytes: int

    def shortage(self) -> str | None:
        """What is wrong with the disk, as a sentence's beginning; None while more than the reserve is free."""
        found = room(self.folder)
        if found.free_bytes >= self.reserve_bytes:
            return None
        left = f"{mb(found.free_bytes)} of {mb(found.total_bytes)} are free, and {mb(self.reserve_bytes)} are kept for finishing"
        return f"the disk of database and files is full ({left})"

    def check(self) -> None:
        """Has room for something new.

        Raises:
            Unavailable: the reserve is reached.
        """
        if (shortage := self.shortage()) is not None:
            detail = f"Nothing new is accepted: {shortage}. Try again once the farm's operator has made room."
            raise Unavailable("disk-full", detail)
