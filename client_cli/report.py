"""``trifarm report``: what a user came for."""

import json
import os

from client_cli.api_client import ApiClient
from client_cli.options import JobArgument, JsonOption
from client_cli.output import print_document, print_line
from client_cli.settings import load_connection


def report(job_id: JobArgument, as_json: JsonOption = False) -> None:
    """Print a job's report: success rate with intervals, robots, trials, and whose fault each failure was."""
    with ApiClient(load_connection(os.environ)) as client:
        if as_json:
            print_document(json.loads(client.report(job_id)))
        else:
            print_line(client.report_text(job_id).rstrip())
