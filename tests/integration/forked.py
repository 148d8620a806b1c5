"""Processes of a farm that are forked from one which has their programs imported: they begin at once and do the rest as always.

Importing takes services some seconds of a processor, a fork some milliseconds. The process to fork from is that of
multiprocessing's fork server; it lives as long as this one and imports nothing that services must not load. There is one of them
in a process, and workers of fits and trainings may have begun it before with what they need: then another takes its place.
"""

import importlib
import multiprocessing
import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from multiprocessing import forkserver
from pathlib import Path
from types import ModuleType

IMPORTED = [
    "services.serve",
    "services.__main__",
    "aiosqlite",
    "uvicorn.loops.auto",
    "uvicorn.protocols.http.auto",
    "tests.integration.scripted_robot",
]
LINK_LEASE_MS = 20_000
"""A process on a machine that stalls is not one that has gone; one that ends closes its links, however long this is."""
_context = multiprocessing.get_context("forkserver")
_own_servers: set[int] = set()
"""Fork servers that were begun here; what another user asks to be imported comes too late for them."""


class Forked:
    """What of ``subprocess.Popen`` tests use."""

    def __init__(self, module, arguments, *, cwd, env, errors=None):
        """``main`` of a module with these arguments and variables; what it says goes to the file ``errors`` if given."""
        self._process = _context.Process(
            target=_run, args=(module, [str(each) for each in arguments], cwd, dict(env), errors), daemon=True
        )
        with _without_main():
            _begin_own_server()
            self._process.start()
        self.pid = self._process.pid

    def poll(self):
        return self._process.exitcode

    def wait(self, timeout=None):
        self._process.join(timeout)
        if self.poll() is None:
            raise subprocess.TimeoutExpired(str(self._process), timeout)
        return self.poll()

    def send_signal(self, number):
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self):
        self.send_signal(signal.SIGTERM)

    def kill(self):
        self.send_signal(signal.SIGKILL)


def _begin_own_server():
    server = forkserver._forkserver
    if server._forkserver_pid not in _own_servers:
        server._stop()
        server.set_forkserver_preload(IMPORTED)
        server.ensure_running()
        _own_servers.add(server._forkserver_pid)


@contextmanager
def _without_main():
    """The fork server would have the new process import the program of this one, which may be a benchmark."""
    program, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = program


def _run(module, arguments, cwd, env, errors):
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(env)
    if errors is not None:
        with Path(errors).open("ab") as said:
            os.dup2(said.fileno(), 1)
            os.dup2(said.fileno(), 2)
    from api_schemas import bus

    bus.LINK_LEASE_MS = LINK_LEASE_MS
    sys.argv = [module, *arguments]
    importlib.import_module(module).main()
