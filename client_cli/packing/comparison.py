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
from client_cli.packing.original import Batching, Original
from client_cli.packing.recipe import Array, Normaliser
from client_cli.terminal.errors import ClientError, UsageProblem

OBSERVATIONS = 1000
TRIALS = 20
"""The observations come in as many trials, so that memory is compared as well, and forgetting it."""
LIMIT = 1e-5
"""Largest difference of an action that passes, N m or rad, where the original's own rounding is finer."""
ROUNDING_TIMES = 10.0
"""Largest difference that passes, as a multiple of what the original differs from itself by in batches of 1 and 1,000."""
COARSE = 1e-3
"""A difference of so much of the largest action is no rounding."""
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
    """What was found over all observations, in the action's unit.

    ``rounding`` is what the original differs from itself by in batches of 1 and 1,000, 0 where it cannot be asked for batches;
    ``allowed`` is the largest difference that passes.
    """

    largest_difference: float
    largest_action: float
    rounding: float
    allowed: float


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


def compare(original: Original, graph: bytes, given: Array, tolerance: float | None = None) -> Compared:
    """Run both through the same trials; both begin each trial with nothing remembered.

    Args:
        original: the policy before it was packed.
        graph: the policy as robots would run it.
        given: observations, shape (trials, steps, n).
        tolerance: the largest difference that passes; by the original's own rounding if None.
    """
    packed = GraphRunner(policy_graph.session(graph))
    wanted, got = [], []
    for trial in given:
        original.begin()
        packed.forget()
        for row in trial:
            wanted.append(original.act(row))
            got.append(packed.act(row[None])[0])
    singly = np.stack(wanted)
    rounding = _own_rounding(original, given.reshape(-1, given.shape[-1]), singly)
    largest = float(np.abs(singly).max())
    allowed = max(LIMIT, min(ROUNDING_TIMES * rounding, COARSE * largest)) if tolerance is None else tolerance
    return Compared(float(np.abs(singly - np.stack(got)).max()), largest, rounding, allowed)


def _own_rounding(original: Original, rows: Array, singly: Array) -> float:
    """The largest difference of the original from itself in batches of 1 and of all rows."""
    together = original.batch(rows) if isinstance(original, Batching) else None
    return 0.0 if together is None or together.shape != singly.shape else float(np.abs(together - singly).max())


def check(compared: Compared, unit: str, original: Original, given: Array) -> None:
    """Raises unless the difference is small enough.

    Raises:
        DiffersError: says by how much, and why.
    """
    if not compared.largest_difference <= compared.allowed:
        raise DiffersError(
            f"the packed policy differs from the original by up to {compared.largest_difference:.3g} {unit} "
            f"(allowed {compared.allowed:.2g}, largest action {compared.largest_action:.3g}); nothing was written. "
            f"{cause(compared, original, given)}"
        )


def cause(compared: Compared, original: Original, given: Array) -> str:
    """Why they differ, by trying the original once more: with the same random numbers, and then with others."""
    if not np.array_equal(_seeded(original, given[0][:1]), _seeded(original, given[0][:3][::-1])):
        return (
            "The original answers by what it saw before: it keeps memory to itself, which a graph does not. Pack the training's "
            "checkpoint instead, or export it with its states as inputs and outputs (--state)"
        )
    if not np.array_equal(_seeded(original, given[0][:1], seed=1), _seeded(original, given[0][:1], seed=2)):
        return "The original gives another action for the same observation: it draws random numbers; export its mean action"
    if compared.largest_difference <= COARSE * compared.largest_action:
        return (
            f"They agree but for rounding, and the original itself differs by {compared.rounding:.2g} between batches of 1 and "
            f"1,000; --tolerance {2 * compared.largest_difference:.1g} takes it as it is"
        )
    return (
        "The exported graph computes something else, mostly because tracing has fixed a branch that depends on what is seen: "
        "export with torch.jit.script, or write the branch as torch.where"
    )


def _seeded(original: Original, rows: Array, seed: int = 0) -> Array:
    """The action of the last of some observations of a trial, drawn with a seed that is set right before it."""
    import torch

    action = np.zeros(0)
    original.begin()
    for row in rows:
        torch.manual_seed(seed)
        action = original.act(row)
        original.begin()
    return action
