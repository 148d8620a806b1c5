"""``trifarm fetch``: a job's logs and report as files."""

import json
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event
from typing import Annotated

import typer

from api_schemas.job import FINAL_JOB_STATES, Job, JobState
from api_schemas.trial import Trial
from client_cli.connection.api_client import ApiClient, StoredFile, log_of
from client_cli.connection.log_download import Download, download, log_name, truth_name
from client_cli.connection.settings import load_connection
from client_cli.terminal.errors import ClientError, Refused, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.options import JobArgument, JsonOption
from client_cli.terminal.output import counted, note, print_document, print_line
from client_cli.views.following import ending
from report_views.trial_table import COLUMNS, as_csv, row

REPORT_NAME = "report.json"
OWNER_NAME = "job_id.txt"
"""Says whose logs a folder holds for as long as it has no report."""
ANY_LOG = "trial-*.mcap"
TABLES = (".csv", ".parquet")
FORBIDDEN = 403


@dataclass(frozen=True)
class Fetched:
    """What a folder holds after a fetch; ``report`` is None for a job that ended without one, ``table`` if none was asked for."""

    job: Job
    folder: Path
    logs: tuple[Path, ...]
    truths: tuple[Path, ...]
    already_there: int
    received_bytes: int
    report: Path | None
    table: Path | None = None


def fetch(
    job_id: JobArgument,
    to: Annotated[
        Path | None, typer.Option("--to", metavar="DIR", help="Folder for the logs; created if absent.", show_default=False)
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option("--table", metavar="FILE", help="Trials as a table, FILE.csv or FILE.parquet.", show_default=False),
    ] = None,
    *,
    parallel: Annotated[int, typer.Option("--jobs", min=1, max=16, help="Number of parallel downloads.")] = 4,
    truth: Annotated[bool, typer.Option("--truth", help="Also fetch the truth of each trial (operators only).")] = False,
    as_json: JsonOption = False,
) -> None:
    """Download a job's logs (trial-000.mcap …), then report.json. A second run downloads only missing files."""
    if to is None and table is None:
        raise UsageProblem("say what to fetch: logs with --to DIR, the table of trials with --table FILE, or both")
    if table is not None and table.suffix not in TABLES:
        raise UsageProblem(f"{table.name} is none of {', '.join(TABLES)}; name the table so")
    with ApiClient(load_connection(os.environ)) as client:
        if table is not None:
            write_table(client.trials(job_id), table)
            note(f"the trials of job {job_id} are in {table}")
        if to is None:
            if as_json:
                print_document({"job_id": job_id, "table": str(table)})
            return
        fetched = fetch_job(client, job_id, to, parallel, with_truth=truth)
    if as_json:
        print_document(document(replace(fetched, table=table)))
    else:
        truths = f" and {counted(len(fetched.truths), 'truth')}" if truth else ""
        print_line(
            f"{counted(len(fetched.logs), 'log')}{truths} in {fetched.folder} ({fetched.already_there} were there already)"
        )
    if fetched.report is None:
        note(f"no {REPORT_NAME}: {ending(fetched.job)}")
        raise typer.Exit(ExitCode.JOB_WITHOUT_REPORT)


def write_table(trials: Sequence[Trial], table: Path) -> None:
    """Writes trials as a table, by the file's suffix."""
    if table.suffix == ".csv":
        _write_whole(as_csv(trials).encode(), table)
    else:
        import pyarrow
        from pyarrow import parquet

        rows, kept = [row(trial) for trial in trials], pyarrow.BufferOutputStream()
        parquet.write_table(pyarrow.table({name: [each[name] for each in rows] for name in COLUMNS}), kept)
        _write_whole(kept.getvalue().to_pybytes(), table)


def document(fetched: Fetched) -> dict[str, object]:
    """A fetch as JSON."""
    return {
        "job_id": fetched.job.job_id,
        "state": fetched.job.state.value,
        "folder": str(fetched.folder),
        "logs": [str(path) for path in fetched.logs],
        "truths": [str(path) for path in fetched.truths],
        "already_there": fetched.already_there,
        "received_bytes": fetched.received_bytes,
        "report": str(fetched.report) if fetched.report else None,
        "table": str(fetched.table) if fetched.table else None,
    }


def fetch_job(client: ApiClient, job_id: str, folder: Path, parallel: int, *, with_truth: bool = False) -> Fetched:
    """Bring all logs of an ended job to ``folder``, then its report: if that is there, the folder is complete."""
    job = client.job(job_id)
    if job.state not in FINAL_JOB_STATES:
        raise ClientError(
            f"job {job_id} is still {job.state.value} ({job.trials_done} of {job.trials} trials done); "
            f"'trifarm watch {job_id}' waits for its end"
        )
    _claim_folder(folder, job_id)
    trials = [trial for trial in client.trials(job_id) if trial.log_sha256]
    logs = [(log_of(trial), folder / log_name(trial.ordinal)) for trial in trials]
    truths = _truths_of(client, trials, folder) if with_truth else []
    downloads = _download_all(client, logs + truths, parallel)
    report = None
    if job.state is JobState.SUCCEEDED:
        report = _write_whole(client.report(job_id), folder / REPORT_NAME)
        (folder / OWNER_NAME).unlink(missing_ok=True)
    return Fetched(
        job=job,
        folder=folder,
        logs=tuple(path for _, path in logs),
        truths=tuple(path for _, path in truths),
        already_there=sum(download.was_there for download in downloads),
        received_bytes=sum(download.size_bytes for download in downloads if not download.was_there),
        report=report,
    )


def _truths_of(client: ApiClient, trials: list[Trial], folder: Path) -> list[tuple[StoredFile, Path]]:
    known = [trial for trial in trials if trial.has_truth]
    try:
        return [(client.truth(trial.trial_id), folder / truth_name(trial.ordinal)) for trial in known]
    except Refused as error:
        if error.problem.status != FORBIDDEN:
            raise
        # The question is a HEAD, whose answer has no text of its own.
        detail = "truths are for operators: this token lacks the scope operate; without --truth the logs alone are fetched"
        raise Refused(error.problem.model_copy(update={"title": "Not allowed", "detail": detail})) from error


def _claim_folder(folder: Path, job_id: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    held = held_by(folder)
    if held not in (None, job_id):
        raise UsageProblem(f"{folder} holds the logs of job {held}; choose another folder for job {job_id}")
    if held is None:
        _write_whole(f"{job_id}\n".encode(), folder / OWNER_NAME)


def held_by(folder: Path) -> str | None:
    """The job whose logs a folder holds, None without logs or a folder.

    Raises:
        UsageProblem: it cannot be read, or it has logs and names no job.
    """
    try:
        held = _named_in(folder)
    except (OSError, ValueError, AttributeError) as error:
        raise UsageProblem(f"cannot use the folder {folder}: {error}") from error
    if not held and (logs := sorted(folder.glob(ANY_LOG))):
        raise UsageProblem(
            f"{folder} holds {logs[0].name} and does not say of which job; choose another folder, or, to go on with its job, "
            f"write that job's id into {folder / OWNER_NAME}"
        )
    return held or None


def _named_in(folder: Path) -> str | None:
    with suppress(FileNotFoundError):
        return json.loads((folder / REPORT_NAME).read_text()).get("job_id")
    with suppress(FileNotFoundError):
        return (folder / OWNER_NAME).read_text().strip()
    return None


def _download_all(client: ApiClient, files: list[tuple[StoredFile, Path]], parallel: int) -> list[Download]:
    stop = Event()
    with ThreadPoolExecutor(parallel, thread_name_prefix="fetch") as pool:
        waiting = [pool.submit(download, client, stored, path, stop) for stored, path in files]
        try:
            return [future.result() for future in as_completed(waiting)]
        finally:
            # After an error or Ctrl-C the downloads still under way must not hold up the end.
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)


def _write_whole(content: bytes, path: Path) -> Path:
    part = path.with_name(path.name + ".part")
    part.write_bytes(content)
    return part.replace(path)
