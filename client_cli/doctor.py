"""``trifarm doctor``: what is wrong with an embedded farm's folder, if anything is."""

import os
from typing import Annotated

import typer

from client_cli.exit_codes import ExitCode
from client_cli.options import JsonOption
from client_cli.output import print_document, print_table
from client_cli.settings import default_data_folder
from client_cli.upkeep import DataOption, run_upkeep


def doctor(
    data: DataOption = None,
    deep: Annotated[bool, typer.Option("--deep", help="Read every file and compare it with its hash.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Look through a farm's database, files, reports and disk; the farm may run meanwhile."""
    folder = (data or default_data_folder(os.environ)).absolute()
    said = run_upkeep("doctor", "--data", str(folder), *(["--deep"] if deep else []))
    if as_json:
        print_document(said)
    else:
        print_table(("", "what", "found"), ((each["level"], each["what"], each["text"]) for each in said["findings"]))
    raise typer.Exit(ExitCode.OK if said["healthy"] else ExitCode.OTHER)
