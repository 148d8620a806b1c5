"""``trifarm restore``: a farm from a backup."""

import os
from pathlib import Path
from typing import Annotated

import typer

from client_cli.options import JsonOption
from client_cli.output import print_document, print_line
from client_cli.settings import default_data_folder
from client_cli.upkeep import DataOption, run_upkeep


def restore(
    backup: Annotated[Path, typer.Option("--from", metavar="DIR", help="The folder that 'trifarm backup' made.")],
    data: DataOption = None,
    as_json: JsonOption = False,
) -> None:
    """Make the farm that a backup holds, in an empty folder; every file is checked on the way."""
    folder = (data or default_data_folder(os.environ)).absolute()
    made = run_upkeep("restore", "--data", str(folder), "--from", str(backup.absolute()))
    if as_json:
        print_document(made)
        return
    print_line(f"restored to {made['data']}, as it was at {made['made_at']}: {made['jobs']} jobs, {made['reports']} reports")
    print_line(f"'trifarm up --data {made['data']}' starts it")
