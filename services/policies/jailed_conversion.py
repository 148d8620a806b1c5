"""The conversion of a policy as the server asks for it: in a jailed child process, whose answer is read with suspicion."""

import json
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from api_schemas.policy import MAX_WEIGHTS_BYTES, PolicyManifest, canonical_json
from jail.level import JailLevel
from services.child_process import ChildKilledError, Ended, run_module
from services.errors import Refused, Unavailable
from services.policies.conversion import DRY_RUN_CPU_S
from services.policies.unfit import UnfitError, refused, too_slow

PROBLEM_FIELDS = frozenset({"why", "part", "instead", "slug", "pack"})


@dataclass(frozen=True)
class Converted:
    """The graph's file, and what the dry run found worth saying."""

    graph: Path
    warnings: tuple[str, ...]


async def convert(
    weights: Path,
    manifest: PolicyManifest,
    folder: Path,
    deadline_s: float,
    least: JailLevel = JailLevel.NONE,
    *,
    limit_bytes: int = MAX_WEIGHTS_BYTES,
    filename: str | None = None,
) -> Converted:
    """Converts in a jailed child process, which gets ``folder`` for its own.

    Args:
        weights: the file, named by its format.
        manifest: what they expect and give.
        folder: where manifest and graph are written; the child sees no other.
        deadline_s: how long it may take.
        least: the level that the jail must reach.
        limit_bytes: the most that weights may have; a graph may have about twice as many.
        filename: what the weights' owner calls them; without it the path's name.

    Raises:
        Refused: the policy cannot be converted.
        Unavailable: the jail does not reach the level ``least``.
    """
    expected, graph = folder / "manifest.json", folder / "policy.onnx"
    expected.write_text(canonical_json(manifest))
    given = (str(weights), str(expected), graph.name, least.value, str(limit_bytes))
    try:
        ended = await run_module("services.policies.conversion", *given, folder=folder, deadline_s=deadline_s)
    except ChildKilledError as error:
        raise _failed(str(error), filename or weights.name) from error
    return _read(ended, graph, filename or weights.name)


def _last_line(said: bytes) -> dict[str, Any]:
    """What the child said last; nothing where it is not as the child writes it, for it may be the stranger's by then."""
    try:
        last = json.loads(said.decode().splitlines()[-1])
        problem, warnings = last.get("problem", {}), last.get("warnings", [])
        known = all(type(each) in (str, bool) for each in problem.values()) and set(problem) <= PROBLEM_FIELDS
        return last if known and all(isinstance(each, str) for each in warnings) else {}
    except (ValueError, LookupError, AttributeError, TypeError, RecursionError):
        return {}


def _read(ended: Ended, graph: Path, filename: str) -> Converted:
    last = _last_line(ended.said)
    if "too_open" in last:
        raise Unavailable("jail-too-open", f"The farm takes no policies now: {last['too_open']}. Its operator can change that.")
    if "broken" in last:
        raise Unavailable("conversion-broken", f"The policy could not be converted by a fault of the farm: {last['broken']}.")
    if "why" in last.get("problem", {}):
        raise refused(UnfitError(**last["problem"]), filename)
    if "warnings" in last:
        return Converted(graph, tuple(f"Dry run: the policy {warning}." for warning in last["warnings"]))
    if last.get("converted") and ended.status == -signal.SIGPROF:
        raise refused(too_slow(f"the network used more than {DRY_RUN_CPU_S:g} s of CPU time and was stopped"), filename)
    raise _failed(f"the converting process {ended.how}", filename)


def _failed(why: str, filename: str) -> Refused:
    instead = "it asks for more time or memory than a policy may have; send a smaller network"
    return refused(UnfitError(f"the policy cannot be converted: {why}", instead=instead), filename)
