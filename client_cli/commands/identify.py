"""``trifarm identify``: excitations on one robot, recorded as logs from which its physics can be told."""

import os
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from pydantic import ValidationError

from api_schemas.excitation import MAX_EXCITATION_SEED, MAX_REPEATS, ExcitationName, IdentificationRequest
from api_schemas.job import Job
from client_cli.commands.fetch import Fetched, fetch_job, held_by
from client_cli.commands.robots import robot_meant
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.options import IdempotencyKeyOption, JsonOption, WaitOption
from client_cli.terminal.output import counted, note, print_document, print_line
from client_cli.terminal.wrong_values import sentence
from client_cli.views.following import ending, exit_code_of, follow_to_end

PARALLEL_DOWNLOADS = 4


@dataclass(frozen=True)
class Identified:
    """A job that was queued, and its logs if they were asked for."""

    job: Job
    fetched: Fetched | None


def identify(
    robot: Annotated[
        str, typer.Option("--robot", metavar="ROBOT|any", help="Robot to identify; any takes the first idle robot.")
    ],
    *,
    excitation: Annotated[
        list[ExcitationName] | None,
        typer.Option("--excitation", help="Only this excitation, by default all; repeatable.", show_default=False),
    ] = None,
    repeats: Annotated[
        int, typer.Option("--repeats", min=1, max=MAX_REPEATS, help="Number of times that the whole list runs.")
    ] = 1,
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, max=MAX_EXCITATION_SEED, help="Seed of the excitations; by default the server draws it."),
    ] = None,
    to: Annotated[
        Path | None, typer.Option("--to", metavar="DIR", help="Wait for the end and fetch the logs to this folder.")
    ] = None,
    wait: WaitOption = False,
    idempotency_key: IdempotencyKeyOption = None,
    as_json: JsonOption = False,
) -> None:
    """Queue excitations on one robot and print the job's id; each excitation is a trial with its own log."""
    request = _request(robot, excitation, repeats, seed)
    # Now, and not when everything has been recorded; with a key of the user's it may be this very job.
    if to is not None and idempotency_key is None and (held := held_by(to)) is not None:
        raise UsageProblem(f"{to} holds the logs of job {held}; choose another folder")
    with ApiClient(load_connection(os.environ)) as client:
        with robot_meant(client, robot):
            job = client.create_identification(request, idempotency_key or uuid.uuid4().hex)
        if not as_json:
            print_line(job.job_id)
        if wait or to is not None:
            job = follow_to_end(client, job.job_id)
            note(ending(job))
        fetched = None
        if to is not None and exit_code_of(job) is ExitCode.OK:
            fetched = fetch_job(client, job.job_id, to, PARALLEL_DOWNLOADS)
            note(f"{counted(len(fetched.logs), 'log')} in {fetched.folder}")
    if as_json:
        print_document(document(Identified(job, fetched)))
    if wait or to is not None:
        raise typer.Exit(exit_code_of(job))


def _request(robot: str, excitation: list[ExcitationName] | None, repeats: int, seed: int | None) -> IdentificationRequest:
    chosen = tuple(excitation) if excitation else tuple(ExcitationName)
    try:
        return IdentificationRequest(robot=robot, excitations=chosen, repeats=repeats, seed=seed)
    except ValidationError as error:
        raise UsageProblem(sentence(error, "the identification")) from error


def document(identified: Identified) -> dict[str, object]:
    """The job, with the folder and the files of its logs if they were fetched."""
    fetched = identified.fetched
    return identified.job.model_dump(mode="json") | {
        "folder": None if fetched is None else str(fetched.folder),
        "logs": None if fetched is None else [str(path) for path in fetched.logs],
    }
