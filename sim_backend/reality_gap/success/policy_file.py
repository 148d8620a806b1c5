"""A policy from its file: the graph that robots run, or weights that the farm's own conversion makes one of."""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from api_schemas import policy_graph
from api_schemas.policy import LAYOUTS, PolicyManifest
from api_schemas.policy_graph import GraphRunner, Session
from sim_backend.evaluation import Act

CONVERSION = "services.policies.conversion"
"""The program that converts weights; it is started as a process of its own, and nothing of it is imported."""
ANY_JAIL = "none"
"""The least confinement that is asked of it: the weights are the user's own."""


def load_policy(weights: Path, manifest: str) -> tuple[Act, PolicyManifest]:
    """A policy as a function of observations (n, size), and what it expects.

    Args:
        weights: a safetensors or ONNX file, as it was uploaded.
        manifest: name of a ready-made layout, or path of a manifest in JSON.

    Raises:
        ValueError: there is no such layout or file, or weights and manifest do not make a policy; the message says why.
    """
    expected = _manifest(manifest)
    if not weights.is_file():
        raise ValueError(f"there is no policy file {weights}")
    return _act(_converted(weights, expected)), expected


def _manifest(given: str) -> PolicyManifest:
    if given in LAYOUTS:
        return LAYOUTS[given]
    path = Path(given)
    if not path.is_file():
        raise ValueError(f"there is no manifest {given!r}; choose from {', '.join(LAYOUTS)}, or name a JSON file")
    return PolicyManifest.model_validate_json(path.read_bytes())


def _converted(weights: Path, manifest: PolicyManifest) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        wanted, graph = Path(folder) / "manifest.json", Path(folder) / "graph.onnx"
        wanted.write_text(manifest.model_dump_json())
        command = [sys.executable, "-m", CONVERSION, str(weights.absolute()), str(wanted), str(graph), ANY_JAIL]
        ended = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
        if not graph.exists():
            raise ValueError(f"{weights} is no policy for this manifest: {(ended.stdout or ended.stderr).strip()[-500:]}")
        return graph.read_bytes()


def _act(graph: bytes) -> Act:
    """The graph as robots run it: one observation at a time, in one thread."""
    return GraphPolicy(policy_graph.session(graph))


class GraphPolicy:
    """A policy in many trials at once; what it remembers of each trial is its own."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._trials: list[GraphRunner] = []

    def begin(self, trials: int) -> None:
        """Begin that many new trials, with nothing remembered."""
        self._trials = [GraphRunner(self._session) for _ in range(trials)]

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Actions (n, 9) of the next observation (n, size) of each trial, float32."""
        if not self._trials:
            self.begin(len(observation))
        pairs = zip(self._trials, observation, strict=True)
        return np.concatenate([trial.act(row[None]) for trial, row in pairs])
