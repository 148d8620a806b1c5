"""What a converting child costs, measured by the kernel from its start to its end."""

import asyncio
import json
import os
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from jail.environment import jail_environment
from services.child_process import Ended
from services.policies import jailed_conversion


@dataclass
class Cost:
    """CPU time and the most memory that was resident; of the dearest child, where there are several."""

    cpu_s: float = 0.0
    memory_bytes: int = 0


@contextmanager
def measured_children():
    """Has ``convert`` start its children as always, but each through a small process that tells what it cost."""
    cost = Cost()

    async def run_module(module, *arguments, folder, deadline_s):
        async with asyncio.timeout(deadline_s):
            return await asyncio.to_thread(run_measured, cost, [sys.executable, "-P", "-m", module, *arguments], folder)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jailed_conversion, "run_module", run_module)
        yield cost


LAUNCHER = """
import json, os, sys
child = os.posix_spawn(sys.argv[2], sys.argv[2:], os.environ)
_, status, used = os.wait4(child, 0)
with open(sys.argv[1], "w") as file:
    json.dump([status, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024], file)
"""
"""Stands between this process and the child: a process begins with the largest memory of the one that started it."""


def run_measured(cost, command, folder):
    """Runs a command as a child in a jail is run, and adds what it took to ``cost``."""
    with tempfile.TemporaryDirectory() as notes:
        told = Path(notes) / "used.json"
        process = subprocess.run(
            [sys.executable, "-I", "-S", "-c", LAUNCHER, str(told), *command],
            cwd=folder,
            env=jail_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            check=True,
        )
        status, cpu_s, memory_bytes = json.loads(told.read_text())
    cost.cpu_s = max(cost.cpu_s, cpu_s)
    cost.memory_bytes = max(cost.memory_bytes, memory_bytes)
    return Ended(os.waitstatus_to_exitcode(status), process.stdout)
