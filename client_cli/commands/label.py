"""``trifarm label``: what a job is called, and what one wants to remember of it."""

import os

from api_schemas.job import LONGEST_NAME, LONGEST_NOTE, JobLabels
from api_schemas.visible import visible
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.options import JobArgument, JsonOption, NameOption, NoteOption
from client_cli.terminal.output import print_document, print_line


def label(job_id: JobArgument, name: NameOption = None, note: NoteOption = None, as_json: JsonOption = False) -> None:
    """Name a job, or note something about it; an empty text takes it away."""
    given = {key: text for key, text in (("name", name), ("note", note)) if text is not None}
    if not given:
        raise UsageProblem("give --name, --note or both; an empty text takes it away")
    with ApiClient(load_connection(os.environ)) as client:
        job = client.label(job_id, labels_of(given))
    if as_json:
        print_document(job)
    else:
        print_line(visible(f"{job.job_id}: {job.name or 'no name'}{'' if job.note is None else f' ({job.note})'}"))


def labels_of(given: dict[str, str]) -> JobLabels:
    """Name and note that fit.

    Raises:
        UsageProblem: one is too long.
    """
    for key, most in (("name", LONGEST_NAME), ("note", LONGEST_NOTE)):
        if len(given.get(key, "")) > most:
            raise UsageProblem(f"the {key} has {len(given[key])} characters; at most {most} are kept")
    return JobLabels.model_validate(given)
