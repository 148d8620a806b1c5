"""A policy for the shortest task, which it need not solve: trials of it cost least."""

from pathlib import Path

from api_schemas.policy import canonical_json
from tests.end_to_end.recurrent import MANIFEST
from tests.graphs import linear


def reaching(folder: Path) -> Path:
    """Its file in a folder, with its manifest beside."""
    path = linear(folder / "reaching.onnx", inputs=MANIFEST.observation_size)
    path.with_suffix(".json").write_text(canonical_json(MANIFEST))
    return path
