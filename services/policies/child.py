"""Starts the converting child, waits for it, and reads what it said."""

import asyncio
import json
import os
import signal
import sys
from dataclasses import dataclass
from pathlib import Path

import services
from services.errors import Refused
from services.policies.conversion import SMOKE_CPU_S

KEPT_ENVIRONMENT = ("PATH", "LANG", "LD_LIBRARY_PATH")
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


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
    child = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "services.policies.conversion",
        str(weights),
        str(manifest),
        str(out),
        cwd=out.parent,
        env=_environment(),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
        start_new_session=True,
    )
    timed_out = False
    try:
        async with asyncio.timeout(deadline_s):
            said, _ = await child.communicate()
    except TimeoutError:
        timed_out = True
        said = b""
    finally:
        if child.returncode is None:
            os.killpg(child.pid, signal.SIGKILL)
            await child.wait()
    if timed_out:
        raise Refused("conversion-failed", f"The policy could not be converted: it took more than {deadline_s:g} s.")
    return _read(said, child.returncode or 0, out)


def _read(said: bytes, status: int, out: Path) -> Converted:
    lines = [json.loads(line) for line in said.decode().splitlines()]
    last = lines[-1] if lines else {}
    if "problem" in last:
        raise Refused("conversion-failed", f"The policy cannot be converted: {last['problem']}.")
    if "warnings" in last:
        return Converted(out, tuple(f"Smoke run: the network {warning}." for warning in last["warnings"]))
    if last.get("converted") and status == -signal.SIGPROF:
        return Converted(out, (f"Smoke run: the network used more than {SMOKE_CPU_S:g} s of CPU time and was stopped.",))
    ended = f"was ended by signal {-status}" if status < 0 else f"ended with status {status}"
    raise Refused("conversion-failed", f"The policy cannot be converted: the converting process {ended}.")


def _environment() -> dict[str, str]:
    kept = {name: os.environ[name] for name in KEPT_ENVIRONMENT if name in os.environ}
    return {**kept, **ONE_THREAD, "PYTHONPATH": str(Path(services.__file__).parent.parent)}
