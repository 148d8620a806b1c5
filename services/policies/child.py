"""Starts the converting child, waits for it, and reads what it said."""

import json
import signal
from dataclasses import dataclass
from pathlib import Path

from api_schemas.jail.level import JailLevel
from services.child import ChildKilledError, Ended, run_module
from services.errors import Refused, Unavailable
from services.policies.conversion import SMOKE_CPU_S


@dataclass(frozen=True)
class Converted:
    """The graph's file, and what the smoke run found worth saying."""

    graph: Path
    warnings: tuple[str, ...]


async def convert(weights: Path, manifest: Path, out: Path, deadline_s: float, least: JailLevel = JailLevel.NONE) -> Converted:
    """Converts in a jailed child process, which gets the folder of ``out`` for its own.

    Raises:
        Refused: the policy cannot be converted.
        Unavailable: the jail does not reach the level ``least``.
    """
    files = (str(weights), str(manifest), out.name, least.value)
    try:
        ended = await run_module("services.policies.conversion", *files, folder=out.parent, deadline_s=deadline_s)
    except ChildKilledError as error:
        raise Refused("conversion-failed", f"The policy could not be converted: {error}.") from error
    return _read(ended, out)


def _read(ended: Ended, out: Path) -> Converted:
    lines = [json.loads(line) for line in ended.said.decode().splitlines()]
    last = lines[-1] if lines else {}
    if "too_open" in last:
        raise Unavailable("jail-too-open", f"The farm takes no policies now: {last['too_open']}. Its operator can change that.")
    if "broken" in last:
        raise Unavailable("conversion-broken", f"The policy could not be converted by a fault of the farm: {last['broken']}.")
    if "problem" in last:
        raise Refused("conversion-failed", f"The policy cannot be converted: {last['problem']}.")
    if "warnings" in last:
        return Converted(out, tuple(f"Smoke run: the network {warning}." for warning in last["warnings"]))
    if last.get("converted") and ended.status == -signal.SIGPROF:
        return Converted(out, (f"Smoke run: the network used more than {SMOKE_CPU_S:g} s of CPU time and was stopped.",))
    raise Refused("conversion-failed", f"The policy cannot be converted: the converting process {ended.how}.")
