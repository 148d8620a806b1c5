"""``trifarm replay``: simulate a log again and see whether the numbers are the same."""

import subprocess
from pathlib import Path
from typing import Annotated

import typer

from client_cli.child_process import child_environment, module_command
from client_cli.errors import UsageProblem
from client_cli.options import JsonOption


def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A trial's log, such as trial-000.mcap.")],
    verify: Annotated[bool, typer.Option("--verify", help="Compare every recorded state, and exit 6 if one differs.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate a log's applied torques again on this machine."""
    if not log.is_file():
        raise UsageProblem(f"there is no log {log}")
    flags = [flag for flag, is_set in (("--verify", verify), ("--json", as_json)) if is_set]
    # The physics runs in a process of its own, so that the client itself never loads a simulator.
    ended = subprocess.run(module_command("sim_backend.replay", str(log), *flags), env=child_environment(), check=False)
    raise typer.Exit(ended.returncode)
