"""Shipped policies as the graphs that robots run, for benchmarks."""

import subprocess
import sys
from pathlib import Path

from api_schemas.builtin_policies import BUILTIN, builtin_content
from api_schemas.policy import PolicyManifest

SHIPPED = Path(__file__).parent.parent.parent / "sim_backend/training/reference_policies"


def graph_of(name: str, folder: Path) -> tuple[Path, PolicyManifest]:
    """The graph, in ``folder``, and the manifest of a shipped policy or a built-in one."""
    graph = folder / f"{name}.onnx"
    if name in BUILTIN:
        graph.write_bytes(builtin_content(name))
        return graph, BUILTIN[name]
    weights, manifest = SHIPPED / f"{name}.safetensors", SHIPPED / f"{name}.json"
    command = [sys.executable, "-m", "services.policies.conversion", str(weights), str(manifest), str(graph), "none"]
    subprocess.run(command, check=True, capture_output=True, cwd=folder)
    return graph, PolicyManifest.model_validate_json(manifest.read_text())
