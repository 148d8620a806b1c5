"""``trifarm jobs``, ``watch`` and ``cancel``: which jobs there are, how one goes on, and its end."""

import os
import shlex
from typing import Annotated

import typer

from api_schemas.job import FINAL_JOB_STATES, Job, JobState, TaskName
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.options import JobArgument, JsonOption
from client_cli.terminal.output import age, note, print_document, print_line, print_table
from client_cli.views.following import ending, exit_code_of, follow_to_end

COLUMNS = ("job", "state", "task", "done", "succeeded", "policy", "owner", "age", "why")
USUAL_LIMIT = 20


def jobs(
    state: Annotated[JobState | None, typer.Option("--state", help="Only jobs in this state.")] = None,
    limit: Annotated[int, typer.Option("--limit", min=1, max=200, help="Maximum number of jobs.")] = USUAL_LIMIT,
    text: Annotated[
        str | None, typer.Option("--search", metavar="TEXT", help="Only jobs with this text in a name, a note or an id.")
    ] = None,
    cursor: Annotated[
        str | None, typer.Option("--cursor", metavar="TEXT", help="Cursor printed with the last page; continue there.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List your jobs, newest first."""
    with ApiClient(load_connection(os.environ)) as client:
        page = client.jobs(limit=limit, state=state, cursor=cursor, text=text)
    if as_json:
        print_document(page)
        return
    if not page.jobs:
        if text:
            note("no job matches")
        elif state:
            note(f"no job is {state.value}")
        else:
            note("no jobs; 'trifarm submit FILE --layout NAME --task TASK' makes one")
        return
    print_table(COLUMNS, (_row(job) for job in page.jobs))
    if page.next_cursor:
        note(f"more: {_next_page(page.next_cursor, state, limit, text)}")


def _next_page(cursor: str, state: JobState | None, limit: int, text: str | None) -> str:
    """The command that lists what follows, of the same jobs."""
    states = [] if state is None else ["--state", state.value]
    limits = [] if limit == USUAL_LIMIT else ["--limit", str(limit)]
    texts = [] if text is None else ["--search", text]
    return shlex.join(["trifarm", "jobs", *states, *limits, *texts, "--cursor", cursor])


def state_word(state: JobState) -> str:
    """The word for a job's state: one that has its report has ended, however few of its trials succeeded."""
    return "ended" if state is JobState.SUCCEEDED else state.value


def _row(job: Job) -> tuple[object, ...]:
    why = job.reason if job.state in FINAL_JOB_STATES else job.waiting_because
    done = f"{job.trials_done}/{job.trials}"
    successes = None if job.task is TaskName.IDENTIFY else job.successes
    return (
        job.job_id,
        state_word(job.state),
        job.task,
        done,
        successes,
        job.policy_name if job.name is None else f"{job.name}: {job.policy_name}",
        job.owner,
        age(job.created_at),
        why or "",
    )


def watch(job_id: JobArgument, as_json: JsonOption = False) -> None:
    """Follow a job with a live bar until it ends; Ctrl-C leaves the job running."""
    with ApiClient(load_connection(os.environ)) as client:
        job, url = follow_to_end(client, job_id), client.url
    if as_json:
        print_document(job)
    else:
        print_line(ending(job, url))
    raise typer.Exit(exit_code_of(job))


def cancel(job_id: JobArgument, as_json: JsonOption = False) -> None:
    """Cancel a job: queued trials never start, running trials stop."""
    with ApiClient(load_connection(os.environ)) as client:
        job = client.cancel(job_id)
    if as_json:
        print_document(job)
    elif job.ended_at:
        print_line(f"job {job.job_id} is cancelled; {job.trials_done} of {job.trials} trials were done")
    else:
        print_line(f"job {job.job_id} is being cancelled; {job.trials_running} trials are still being stopped")
