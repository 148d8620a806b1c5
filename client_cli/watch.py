"""``trifarm watch``: follow a job until it ends."""

import os

import typer

from client_cli.api_client import ApiClient
from client_cli.following import ending, exit_code_of, follow_to_end
from client_cli.options import JobArgument, JsonOption
from client_cli.output import print_document, print_line
from client_cli.settings import load_connection


def watch(job_id: JobArgument, as_json: JsonOption = False) -> None:
    """Follow a job with a live bar until it ends; Ctrl-C leaves the job running."""
    with ApiClient(load_connection(os.environ)) as client:
        job = follow_to_end(client, job_id)
    if as_json:
        print_document(job)
    else:
        print_line(ending(job))
    raise typer.Exit(exit_code_of(job))
