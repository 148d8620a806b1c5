"""``trifarm backup``, ``restore`` and ``doctor``: the services' own program does the work and says what it did."""

import json
import os
from pathlib import Path
from typing import Annotated, Any

import typer

from client_cli.connection.settings import default_data_folder
from client_cli.embedded.child_process import module_command
from client_cli.terminal.child_answer import answer_of
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.foreground import how_it_ended
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import print_document, print_line, print_table

DataOption = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="Data folder of the farm, as for 'trifarm up'.", show_default=False),
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


def backup(
    to: Annotated[Path, typer.Option("--to", metavar="DIR", help="New folder, or the folder of an earlier backup.")],
    data: DataOption = None,
    as_json: JsonOption = False,
) -> None:
    """Copy a farm's database, policies, logs and tokens to a folder; the farm may keep running."""
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


def restore(
    backup: Annotated[Path, typer.Option("--from", metavar="DIR", help="Folder of a backup.")],
    data: DataOption = None,
    as_json: JsonOption = False,
) -> None:
    """Restore a farm from a backup into an empty folder and check every file."""
    folder = (data or default_data_folder(os.environ)).absolute()
    made = run_upkeep("restore", "--data", str(folder), "--from", str(backup.absolute()))
    if as_json:
        print_document(made)
        return
    print_line(f"restored to {made['data']}, as it was at {made['made_at']}: {made['jobs']} jobs, {made['reports']} reports")
    print_line(f"'trifarm up --data {made['data']}' starts it")


def doctor(
    data: DataOption = None,
    deep: Annotated[bool, typer.Option("--deep", help="Read every file and compare it with its hash.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Check a farm's database, files, reports and disk; the farm may keep running."""
    folder = (data or default_data_folder(os.environ)).absolute()
    said = run_upkeep("doctor", "--data", str(folder), *(["--deep"] if deep else []))
    if as_json:
        print_document(said)
    else:
        print_table(("", "what", "found"), ((each["level"], each["what"], each["text"]) for each in said["findings"]))
    raise typer.Exit(ExitCode.OK if said["healthy"] else ExitCode.OTHER)
