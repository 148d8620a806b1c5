"""``trifarm cancel``: stop a job."""

import os

from client_cli.api_client import ApiClient
from client_cli.options import JobArgument, JsonOption
from client_cli.output import print_document, print_line
from client_cli.settings import load_connection


def cancel(job_id: JobArgument, as_json: JsonOption = False) -> None:
    """Cancel a job: queued trials never start, running ones are stopped. Cancelling twice does no harm."""
    with ApiClient(load_connection(os.environ)) as client:
        job = client.cancel(job_id)
    if as_json:
        print_document(job)
    elif job.ended_at:
        print_line(f"job {job.job_id} is cancelled; {job.trials_done} of {job.trials} trials were done")
    else:
        print_line(f"job {job.job_id} is being cancelled; {job.trials_running} trials are still being stopped")
