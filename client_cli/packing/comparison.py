"""The packed policy as the farm would run it, held against the original on a thousand observations."""

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from api_schemas import policy_graph
from api_schemas.policy import PolicyManifest, canonical_json
from api_schemas.policy_graph import GraphRunner
from client_cli.packing.original import Original
from client_cli.packing.recipe import Array, Normaliser
from client_cli.terminal.errors import ClientError, UsageProblem

OBSERVATIONS = 1000
TRIALS = 20
"""The observations come in as many trials, so that memory is compared as well, and forgetting it."""
LIMIT = 1e-5
"""Largest difference of an action that passes, N m or rad."""
SEED = 20220801
CONVERSION = "services.policies.conversion"
"""The farm's own program; a process of its own, of which nothing is imported. It writes in its working folder only."""
ANY_JAIL = "none"
"""The least confinement that is asked of it: the weights are the user's own."""


class DiffersError(ClientError):
    """The packed policy does not compute what the original does."""

    title = "differs"


@dataclass(frozen=True)
class Compared:
    """The largest difference of an action, in the action's unit, and the largest action, over all observations."""

    largest_difference: float
    largest_action: float


def converted(weights: bytes, suffix: str, manifest: PolicyManifest) -> bytes:
    """The graph that the farm makes of a policy.

    Raises:
        UsageProblem: the farm would refuse it; the message is the farm's.
    """
    with tempfile.TemporaryDirectory(prefix="trifarm-pack-") as name:
        folder = Path(name)
        given, wanted, graph = folder / f"weights{suffix}", folder / "manifest.json", folder / "graph.onnx"
        given.write_bytes(weights)
        wanted.write_text(canonical_json(manifest))
        command = [sys.executable, "-m", CONVERSION, str(given), str(wanted), str(graph), ANY_JAIL]
        ended = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
        if graph.exists():
            return graph.read_bytes()
    raise UsageProblem(f"the farm would not take this policy: {_problem(ended.stdout) or ended.stderr.strip()[-500:]}")


def _problem(said: str) -> str:
    lines = [json.loads(line) for line in said.splitlines() if line.startswith("{")]
    problem = next((line["problem"] for line in lines if "problem" in line), "")
    return str(problem.get("why", problem)) if isinstance(problem, dict) else problem


def observations(manifest: PolicyManifest, normaliser: Normaliser | None) -> Array:
    """Observations as the policy knows them, shape (TRIALS, OBSERVATIONS / TRIALS, n), float32."""
    size = manifest.observation_size
    drawn = np.random.default_rng(SEED).normal(size=(TRIALS, OBSERVATIONS // TRIALS, size))
    if normaliser is not None and normaliser.mean.size == size:
        drawn = drawn * np.sqrt(normaliser.variance) + normaliser.mean
    return drawn.astype(np.float32)


def compare(original: Original, graph: bytes, given: Array) -> Compared:
    """Run both through the same trials; both begin each trial with nothing remembered."""
    packed = GraphRunner(policy_graph.session(graph))
    difference = action = 0.0
    for trial in given:
        original.begin()
        packed.forget()
        for row in trial:
            wanted, got = original.act(row), packed.act(row[None])[0]
            difference = float(np.maximum(difference, np.abs(wanted - got).max()))  # NaN stays
            action = max(action, float(np.abs(wanted).max()))
    return Compared(difference, action)


def check(compared: Compared, unit: str) -> None:
    """Raises unless the difference is small enough.

    Raises:
        DiffersError: says by how much, and what it often is.
    """
    if not compared.largest_difference <= LIMIT:
        raise DiffersError(
            f"the packed policy differs from the original by up to {compared.largest_difference:.3g} {unit} "
            f"(allowed {LIMIT:g}, largest action {compared.largest_action:.3g}); nothing was written. Memory that a "
            "program keeps to itself is the usual cause"
        )
