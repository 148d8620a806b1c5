"""``trifarm backup``: a copy of an embedded farm, made while it runs."""

import os
from pathlib import Path
from typing import Annotated

import typer

from client_cli.options import JsonOption
from client_cli.output import print_document, print_line
from client_cli.settings import default_data_folder
from client_cli.upkeep import DataOption, run_upkeep


def backup(
    to: Annotated[Path, typer.Option("--to", metavar="DIR", help="A new folder, or that of an earlier backup.")],
    data: DataOption = None,
    as_json: JsonOption = False,
) -> None:
    """Copy a farm's database, policies, logs and tokens to a folder; the farm may run meanwhile."""
    folder = (data or default_data_folder(os.environ)).absolute()
    made = run_upkeep("backup", "--data", str(folder), "--to", str(to.absolute()))
    if as_json:
        print_document(made)
        return
    print_line(f"backup in {made['folder']}: {made['files']} files of {made['bytes']} bytes, {made['copied']} copied now")
    if made["mended"]:
        print_line(f"{made['mended']} of these replace damaged copies of an earlier backup; look at the disk that they lie on")
    if made["missing"]:
        print_line(f"{made['missing']} logs of the database are not in the farm any more")
