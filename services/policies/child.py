"""Starts the converting child, waits for it, and reads what it said."""

import json
import signal
from dataclasses import dataclass
from pathlib import Path

from services.child import ChildKilledError, Ended, run_module
from services.errors import Refused
from services.policies.conversion import SMOKE_CPU_S


@dataclass(frozen=True)
class Converted:
    """The graph's file, and what the smoke run found worth saying."""

    graph: Path
    warnings: tuple[str, ...]


async def convert(weights: Path, manifest: Path, out: Path, deadline_s: float) -> Converted:
    """Converts in a child process with nothing of this one's environment.

    Raises:
        Refused: the policy cannot be converted.
    """
    files = (str(weights), str(manifest), str(out))
    try:
        ended = await run_module("services.policies.conversion", *files, folder=out.parent, deadline_s=deadline_s)
    except ChildKilledError as error:
        raise Refused("conversion-failed", f"The policy could not be converted: {error}.") from error
    return _read(ended, out)


def _read(ended: Ended, out: Path) -> Converted:
    lines = [json.loads(line) for line in ended.said.decode().splitlines()]
    last = lines[-1] if lines else {}
    if "problem" in last:
        raise Refused("conversion-failed", f"The policy cannot be converted: {last['problem']}.")
    if "warnings" in last:
        return Converted(out, tuple(f"Smoke run: the network {warning}." for warning in last["warnings"]))
    if last.get("converted") and ended.status == -signal.SIGPROF:
        return Converted(out, (f"Smoke run: the network used more than {SMOKE_CPU_S:g} s of CPU time and was stopped.",))
    raise Refused("conversion-failed", f"The policy cannot be converted: the converting process {ended.how}.")
