"""``trifarm report``: what a user came for."""

import json
import os
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.report import Report
from api_schemas.signature import Signature
from client_cli.connection.api_client import ApiClient
from client_cli.connection.farm_keys import keep_key
from client_cli.connection.settings import home_folder, load_connection
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.options import JobArgument, JsonOption
from client_cli.terminal.output import note, print_document, print_line
from client_cli.views.report_pdf import write_pdf
from report_views.page import render_page


def report(
    job_id: JobArgument,
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="Write a signed HTML page, for 'trifarm verify'.")
    ] = None,
    pdf: Annotated[Path | None, typer.Option("--pdf", metavar="FILE", help="Write a PDF for print.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Print a job's report: success rate with intervals, robots, trials, and policy and platform errors."""
    with ApiClient(load_connection(os.environ)) as client:
        for path, write in ((html, write_page), (pdf, write_print)):
            if path is not None:
                write(client, job_id, path)
                note(f"report in {path}")
        if as_json:
            print_document(json.loads(client.report(job_id)))
        elif html is None and pdf is None:
            print_line(client.report_text(job_id).rstrip())


def write_page(client: ApiClient, job_id: str, path: Path) -> None:
    """Writes the signed page of a job's report, and keeps the farm's key if it is seen for the first time."""
    path.write_text(render_page(*_signed(client, job_id)))


def write_print(client: ApiClient, job_id: str, path: Path) -> None:
    """Writes a job's report as a PDF."""
    write_pdf(*_signed(client, job_id), path)


def _signed(client: ApiClient, job_id: str) -> tuple[Report, Signature]:
    stored, signature = client.known_report(job_id), client.signature(job_id)
    if not isinstance(stored, Report):
        raise UsageProblem(f"job {job_id} is an identification; only reports of policies are made as pages")
    keep_key(home_folder(os.environ), client.url, signature.key)
    return stored, signature
