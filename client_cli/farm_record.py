"""What a data folder remembers of the farm that was started on it last, so that its robots' physics can be drawn again."""

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

from client_cli.errors import UsageProblem

RECORD_NAME = "up.json"


@dataclass(frozen=True)
class FarmRecord:
    """The physics that the robots were told, and the farm's seed if one was given."""

    physics: str
    farm_seed: int | None


def save_record(record: FarmRecord, data: Path) -> None:
    """Write the record, readable by its owner only: a farm's seed gives away what is hidden."""
    path = data / RECORD_NAME
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        json.dump(asdict(record), file)


def load_record(data: Path) -> FarmRecord | None:
    """The record of a data folder; None if ``up`` never ran on it.

    Raises:
        UsageProblem: it cannot be read.
    """
    try:
        stored = json.loads((data / RECORD_NAME).read_text())
        return FarmRecord(str(stored["physics"]), stored["farm_seed"])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageProblem(
            f"cannot read {data / RECORD_NAME} ({error!r}); say with --physics what the robots were told"
        ) from error
