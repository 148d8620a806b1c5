"""What is kept of each version, and how a test gets it into a folder of its own."""

import json
import tarfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
VERSIONS = tuple(sorted(path.name for path in HERE.glob("v*_*_*") if path.is_dir()))
FARMS = [(version, physics) for version in VERSIONS for physics in ("nominal", "real")]


def unpacked(version: str, physics: str, to: Path) -> Path:
    """A farm's folder ``farm``, what was fetched of it and its signed page, as they were."""
    with tarfile.open(HERE / version / f"{physics}.tar.xz") as archive:
        archive.extractall(to, filter="data")
    return to


def told(version: str, name: str) -> Any:
    """A JSON file of a version."""
    return json.loads((HERE / version / f"{name}.json").read_text())
