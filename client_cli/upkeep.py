"""What ``backup``, ``restore`` and ``doctor`` share: the services' own program does the work and says what it did."""

import json
import subprocess
from pathlib import Path
from typing import Annotated, Any

import typer

from client_cli.child_process import child_environment, module_command
from client_cli.errors import ClientError
from client_cli.foreground import how_it_ended

DataOption = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="The farm's data folder (that of 'trifarm up').", show_default=False),
]
ENDS = (0, 1)


def run_upkeep(command: str, *flags: str) -> dict[str, Any]:
    """What the command did.

    Raises:
        ClientError: it could not do it, with its sentence.
    """
    ran = subprocess.run(
        module_command("services.upkeep", command, *flags),
        env=child_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        check=False,
    )
    if ran.returncode not in ENDS:
        raise ClientError(f"'{command}' {how_it_ended(ran.returncode)}")
    said = json.loads(ran.stdout)
    if "error" in said:
        raise ClientError(said["error"])
    return said
