"""``trifarm effects``: the catalogue of what can be different about a robot."""

import subprocess

import typer

from client_cli.child_process import child_environment, module_command
from client_cli.options import JsonOption


def effects(as_json: JsonOption = False) -> None:
    """List every effect a robot may have, with the bounds, units and sources of its parameters."""
    flags = ["--json"] if as_json else []
    # A process of its own, so that the client itself never loads a simulator.
    ended = subprocess.run(module_command("sim_backend.effects", *flags), env=child_environment(), check=False)
    raise typer.Exit(ended.returncode)
