"""``trifarm`` commands, each a process forked from one that has imported the command line: importing costs more than most do.

That the command line also starts on its own is tested in ``test_farm.py``. ``python -m tests.end_to_end.commands`` is the process
to fork from: it reads one command a line and answers with its exit code.
"""

import atexit
import functools
import importlib
import json
import os
import select
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from tests import ROOT

USED = ("jobs", "submit", "report", "fetch", "robots", "status", "token", "replay", "identify", "verify", "physics", "gap")
"""Modules of the commands that tests call."""


@functools.cache
def _parent() -> subprocess.Popen[str]:
    """The process to fork from, which ends with this one."""
    command = [sys.executable, "-m", "tests.end_to_end.commands"]
    parent = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(parent.communicate)
    return parent


def run(*arguments: str, env: Mapping[str, str], within_s: float = 280.0) -> subprocess.CompletedProcess[str]:
    """Run ``trifarm`` with these arguments, here and with these variables.

    Raises:
        subprocess.TimeoutExpired: it has not ended in time; every process of the command line is killed.
    """
    parent = _parent()
    assert parent.stdin is not None and parent.stdout is not None
    with tempfile.TemporaryDirectory() as folder:
        out, errors = Path(folder, "out"), Path(folder, "errors")
        asked = {"arguments": arguments, "env": dict(env), "cwd": str(Path.cwd()), "out": str(out), "errors": str(errors)}
        parent.stdin.write(json.dumps(asked) + "\n")
        parent.stdin.flush()
        if not select.select([parent.stdout], [], [], within_s)[0]:
            parent.kill()
            parent.communicate()
            _parent.cache_clear()
            raise subprocess.TimeoutExpired(arguments, within_s)
        code = int(parent.stdout.readline())
        return subprocess.CompletedProcess(arguments, code, out.read_text(), errors.read_text())


def _serve() -> None:
    """Fork a process for each line of standard input until there are no more."""
    for name in ("httpcore", "client_cli.main", *(f"client_cli.commands.{name}" for name in USED)):
        importlib.import_module(name)
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            _become(**json.loads(line))
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)


def _become(arguments: list[str], env: dict[str, str], cwd: str, out: str, errors: str) -> None:
    """Be the command until its end."""
    from client_cli.entry import main

    os.environ.clear()
    os.environ.update(env)
    os.chdir(cwd)
    with Path(out).open("wb") as told, Path(errors).open("wb") as wrong, Path(os.devnull).open("rb") as nothing:
        for number, file in enumerate((nothing, told, wrong)):
            os.dup2(file.fileno(), number)
    sys.argv = ["trifarm", *arguments]
    main()


if __name__ == "__main__":
    _serve()
