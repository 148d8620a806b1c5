"""What became of every sample that was asked for: used once, or dropped, and why.

A line of ``ledger.jsonl`` is appended for each start of a run, and for the samples of an iteration when they are asked for, when
a worker that had some is lost, and when an update has used them. The file outlives the learner: iterations that a later start
does again are those which no checkpoint had.
"""

import json
import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

LEDGER = "ledger.jsonl"
WORKER_LOST, LEARNER_ENDED = "worker lost", "learner ended before its checkpoint"


@dataclass(frozen=True)
class Ledger:
    """The file of a run; owner of its lines.

    Args:
        folder: of the run.
        start: which start of the run this is, from 1.
    """

    folder: Path
    start: int

    @classmethod
    def of_next_start(cls, folder: Path, least: int = 1) -> Self:
        """Of a run that starts now: a learner that ended before its next checkpoint has started, too.

        Args:
            folder: of the run.
            least: number of the start as its checkpoint counts, which has outlived a ledger that is gone.
        """
        starts = [line["start"] for line in _lines(folder) if line["what"] == "started"]
        with (folder / LEDGER).open("a+b") as file:
            file.seek(0)
            if file.read()[-1:] not in (b"", b"\n"):
                file.write(b"\n")  # the last line broke off
        return cls(folder, max([least, *(start + 1 for start in starts)]))

    def write(self, what: str, iteration: int, samples: int = 0, **more: Any) -> None:
        """Append a line: ``started``, ``asked``, ``lost`` (and asked again) or ``used``."""
        line = {"start": self.start, "what": what, "iteration": iteration, "samples": samples} | more
        with (self.folder / LEDGER).open("a") as file:
            file.write(json.dumps(line) + "\n")


@dataclass(frozen=True)
class Account:
    """Sums over a ledger. ``used`` counts what is in the policy now; ``twice`` and ``missing`` name iterations, if any.

    ``asked`` equals ``used`` and all of ``dropped`` together.
    """

    asked: int
    used: int
    dropped: dict[str, int]
    twice: list[int]
    missing: list[int]

    @property
    def adds_up(self) -> bool:
        """Whether every sample has one end, and every iteration was used once."""
        return self.asked == self.used + sum(self.dropped.values()) and not self.twice and not self.missing


def account(folder: Path) -> Account:
    """Add the ledger of a run up."""
    lines = _lines(folder)
    begins = {line["start"]: line["iteration"] for line in lines if line["what"] == "started"}
    asked = sum(line["samples"] for line in lines if line["what"] in ("asked", "lost"))
    lost = sum(line["samples"] for line in lines if line["what"] == "lost")
    ends = {start: min([at for later, at in begins.items() if later > start], default=math.inf) for start in begins}
    kept = [line for line in lines if line["what"] == "used" and line["iteration"] < ends.get(line["start"], math.inf)]
    times = Counter(line["iteration"] for line in kept)
    used_at = {(line["start"], line["iteration"]) for line in kept}
    undone = sum(
        line["samples"] for line in lines if line["what"] == "asked" and (line["start"], line["iteration"]) not in used_at
    )
    dropped = {reason: samples for reason, samples in ((WORKER_LOST, lost), (LEARNER_ENDED, undone)) if samples}
    return Account(
        asked,
        sum(line["samples"] for line in kept),
        dropped,
        [iteration for iteration, n in sorted(times.items()) if n > 1],
        [iteration for iteration in range(max(times, default=-1) + 1) if iteration not in times],
    )


def _lines(folder: Path) -> list[dict[str, Any]]:
    """Of a run's ledger; without those that broke off when a disk was full or the power went."""
    path, found = folder / LEDGER, []
    for text in path.read_text(errors="replace").splitlines() if path.exists() else ():
        try:
            found.append(json.loads(text))
        except json.JSONDecodeError:
            continue
    return found
