"""``trifarm replay``: what a log holds, and whether a new simulation gives the same numbers."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.embedded.child_process import module_command
from client_cli.terminal.child_answer import answer_of, pass_on
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import note, print_document, print_line

REPLAY = "sim_backend.replays.replay"
NEEDS_TRUTH = 7
"""Exit code of a replay that lacks what only the farm knows: the robot's physics."""


def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log of a trial, such as trial-000.mcap.")],
    verify: Annotated[
        bool, typer.Option("--verify", help="Simulate the trial again and compare every number; exit with 6 if one differs.")
    ] = False,
    truth: Annotated[
        Path | None,
        typer.Option("--truth", metavar="FILE", help="Truth of the trial, from 'trifarm fetch --truth'; with --verify."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show the content of a log; with --verify simulate the trial again, on the server if the robot's physics is hidden."""
    if truth is not None and not verify:
        raise UsageProblem("--truth is what --verify compares with; give --verify, too")
    for path in (log, *([] if truth is None else [truth])):
        if not path.is_file():
            raise UsageProblem(f"there is no file {path}")
    flags = ["--verify"] * verify + ([] if truth is None else ["--truth", str(truth)]) + ["--json"] * as_json
    ended = _run(log, *flags)
    if ended.returncode == NEEDS_TRUTH and verify and truth is None:
        raise typer.Exit(_ask_server(log, as_json))
    if ended.returncode == ExitCode.USAGE:
        raise UsageProblem(_reason(ended))
    sys.stderr.write(ended.stderr)
    pass_on("replay", ended)


def _run(log: Path, *flags: str) -> subprocess.CompletedProcess[str]:
    return answer_of(module_command(REPLAY, str(log), *flags), stderr=subprocess.PIPE)


def _reason(ended: subprocess.CompletedProcess[str]) -> str:
    """Why a log or its truth cannot be used: a document with --json, else a line on stderr."""
    if not ended.stdout:
        return ended.stderr.strip().removeprefix("error: ")
    said = json.loads(ended.stdout)
    return ": ".join(filter(None, (said["error"], said.get("hidden"))))


def _ask_server(log: Path, as_json: bool) -> ExitCode:
    trial_id = _trial_of(log)
    with ApiClient(load_connection(os.environ)) as client:
        note(f"{log.name} is of a robot whose physics only its farm knows; {client.url} simulates it again")
        verdict = client.verify(trial_id, log)
    if as_json:
        print_document(verdict)
    else:
        print_line(verdict.in_words(log.name))
    if verdict.same:
        return ExitCode.OK
    return ExitCode.OTHER_FORM if verdict.is_of_other_form else ExitCode.DIFFERS


def _trial_of(log: Path) -> str:
    """The id of the log's trial, as the replay reads it."""
    shown = _run(log, "--json")
    try:
        trial_id = json.loads(shown.stdout)["trial"]["trial_id"]
    except (ValueError, KeyError, TypeError) as error:
        raise UsageProblem(f"{log} does not say which trial it is of: {(shown.stdout or shown.stderr).strip()[:200]}") from error
    return str(trial_id)
