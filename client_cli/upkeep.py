"""What ``backup``, ``restore`` and ``doctor`` share: the services' own program does the work and says what it did."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from client_cli.child_answer import answer_of
from client_cli.child_process import module_command
from client_cli.errors import ClientError, UsageProblem
from client_cli.foreground import how_it_ended

DataOption = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="The farm's data folder (that of 'trifarm up').", show_default=False),
]
ENDS = (0, 1)


def run_upkeep(command: str, *flags: str) -> dict[str, Any]:
    """What the command did.

    Raises:
        UsageProblem: a folder cannot be used, with its sentence.
        ClientError: it broke.
    """
    ran = answer_of(module_command("services.upkeep", command, *flags))
    if ran.returncode not in ENDS or not ran.stdout:
        raise ClientError(f"'{command}' {how_it_ended(ran.returncode)}")
    said = json.loads(ran.stdout)
    if "error" in said:
        raise UsageProblem(said["error"])
    return said
