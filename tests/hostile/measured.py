"""What a converting child costs, measured by the kernel from its start to its end."""

import asyncio
import os
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

from api_schemas.jail.environment import jail_environment
from services.child import Ended
from services.policies import child


@dataclass
class Cost:
    """CPU time and the most memory that was resident; of the dearest child, where there are several."""

    cpu_s: float = 0.0
    memory_bytes: int = 0


@contextmanager
def measured_children():
    """Has ``child.convert`` start its children as always, but waited for by ``wait4``, which tells the cost of each."""
    cost = Cost()

    async def run_module(module, *arguments, folder, deadline_s):
        async with asyncio.timeout(deadline_s):
            return await asyncio.to_thread(_run, cost, [sys.executable, "-P", "-m", module, *arguments], folder)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child, "run_module", run_module)
        yield cost


def _run(cost, command, folder):
    with subprocess.Popen(
        command,
        cwd=folder,
        env=jail_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as process:
        said = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    cost.cpu_s = max(cost.cpu_s, used.ru_utime + used.ru_stime)
    cost.memory_bytes = max(cost.memory_bytes, used.ru_maxrss * 1024)
    return Ended(process.returncode, said)
