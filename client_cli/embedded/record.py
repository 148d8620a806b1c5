"""What a data folder remembers of the farm that was started on it last, so that its robots' physics can be drawn again.

A file of physics is remembered with its content: moving or changing the file afterwards changes neither robots nor their truth.
"""

import json
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from api_schemas.physics import NAMED_PHYSICS
from client_cli.terminal.errors import UsageProblem

RECORD_NAME = "up.json"
PHYSICS_FOLDER = "physics"


@dataclass(frozen=True)
class FarmRecord:
    """The physics that the robots were told, a name or the absolute path of a file, and the farm's seed if one was given."""

    physics: str
    farm_seed: int | None


def keep_physics(physics: str, data: Path) -> str:
    """A named physics as it is; of a file, the path of the copy that the data folder keeps, under the same name."""
    if physics in NAMED_PHYSICS:
        return physics
    kept = data.absolute() / PHYSICS_FOLDER / Path(physics).name
    content = Path(physics).read_bytes()
    kept.parent.mkdir(exist_ok=True, mode=0o700)
    _write(kept, content)
    return str(kept)


def save_record(record: FarmRecord, data: Path) -> None:
    """Write the record, readable by its owner only: a farm's seed gives away what is hidden.

    What lies in the data folder is named from there, so that the folder can be moved.
    """
    told = Path(record.physics)
    physics = str(told.relative_to(data.absolute())) if told.is_relative_to(data.absolute()) else record.physics
    _write(data / RECORD_NAME, json.dumps(asdict(replace(record, physics=physics))).encode())


def _write(path: Path, content: bytes) -> None:
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(content)


def load_record(data: Path) -> FarmRecord | None:
    """The record of a data folder; None if ``up`` never ran on it.

    Raises:
        UsageProblem: it cannot be read.
    """
    try:
        stored = json.loads((data / RECORD_NAME).read_text())
        physics = str(stored["physics"])
        return FarmRecord(physics if physics in NAMED_PHYSICS else str(data.absolute() / physics), stored["farm_seed"])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageProblem(
            f"cannot read {data / RECORD_NAME} ({error!r}); say with --physics what the robots were told"
        ) from error
