"""A farm for programs: submit a policy, wait for its report, go through its trials, read a log as arrays."""

import os
import tempfile
import uuid
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Self

from api_schemas.job import Job, JobPriority, JobRequest, JobState, TaskName
from api_schemas.object import ObjectName
from api_schemas.report import Report, read_report
from api_schemas.trial import OutcomeKind, Trial
from client_cli.api_client import ApiClient, log_of
from client_cli.errors import ClientError
from client_cli.following import follow_to_end
from client_cli.log_download import download, log_name
from client_cli.policy_files import read_policy
from client_cli.report import write_page
from client_cli.settings import Connection, load_connection

if TYPE_CHECKING:
    from api_schemas.trial_log_reader import TrialLog


class Farm:
    """A connection to a farm; use it as a context manager.

    Args:
        url: where it is; without it as for the command line: ``TRIFARM_URL``, or what ``trifarm up`` wrote.
        token: who asks; without it as for the command line.
    """

    def __init__(self, url: str | None = None, token: str | None = None) -> None:
        known = load_connection(os.environ)
        self._client = ApiClient(Connection((url or known.url).rstrip("/"), token or known.token))

    def __enter__(self) -> Self:
        self._client.__enter__()
        return self

    def __exit__(self, *details: object) -> None:
        self._client.__exit__(*details)

    def submit(
        self,
        weights: Path | str,
        *,
        task: TaskName | str,
        trials: int = 40,
        seed: int | None = None,
        layout: str | None = None,
        manifest: Path | None = None,
        object: ObjectName = ObjectName.CUBE,
        object_scale: float = 1.0,
        priority: JobPriority | str = JobPriority.NORMAL,
    ) -> "FarmJob":
        """Uploads a policy and queues a job of it.

        Args:
            weights: a .safetensors, .onnx or stable-baselines3 .zip file.
            task: what is asked of the robots.
            trials: how many goals are tried.
            seed: draws goals and robots; the farm draws one if absent.
            layout: a ready-made manifest by its name.
            manifest: the manifest's file; without it and a layout, the one beside the weights.
            object: what lies between the fingers.
            object_scale: times the object's usual size.
            priority: low waits behind the rest; high goes before it, for operators alone.

        Raises:
            ClientError: the policy cannot be used, or the farm refused it; the text says why.
        """
        policy = read_policy(Path(weights), manifest, layout)
        self._client.upload_policy(policy.digest, policy.weights, policy.manifest)
        wish = JobRequest(
            policy=policy.digest,
            task=TaskName(task),
            trials=trials,
            seed=seed,
            object=object,
            object_scale=object_scale,
            priority=JobPriority(priority),
        )
        return FarmJob(self._client, self._client.create_job(wish, uuid.uuid4().hex))

    def job(self, job_id: str) -> "FarmJob":
        """A job by its id."""
        return FarmJob(self._client, self._client.job(job_id))

    def jobs(self, *, limit: int = 50, state: JobState | None = None) -> tuple["FarmJob", ...]:
        """The newest jobs."""
        return tuple(FarmJob(self._client, job) for job in self._client.jobs(limit=limit, state=state).jobs)


@dataclass
class FarmJob:
    """A job of a farm; ``job`` is what was last heard of it."""

    client: ApiClient = field(repr=False)
    job: Job

    @property
    def id(self) -> str:
        """What the farm calls it."""
        return self.job.job_id

    def refresh(self) -> Job:
        """The job as it is now."""
        self.job = self.client.job(self.id)
        return self.job

    def wait(self) -> Report:
        """Waits for the end, through lost connections, and gives the report; says on standard error how far it is.

        Raises:
            ClientError: the job failed or was cancelled; the text says why.
        """
        self.job = follow_to_end(self.client, self.id)
        return self.report()

    def report(self) -> Report:
        """The report of a job that has ended with one.

        Raises:
            ClientError: it has none, or it is an identification's.
        """
        if self.job.state in {JobState.FAILED, JobState.CANCELLED}:
            raise ClientError(f"job {self.id} {self.job.state}: {self.job.reason or 'no reason given'}")
        report = read_report(self.client.report(self.id))
        if not isinstance(report, Report):
            raise ClientError(f"job {self.id} is an identification; 'trifarm report {self.id} --json' shows what it recorded")
        return report

    def save_report(self, path: Path | str) -> None:
        """Writes the report as one signed page, which ``trifarm verify`` checks."""
        write_page(self.client, self.id, Path(path))

    def trials(self) -> Iterator["FarmTrial"]:
        """The trials in their order."""
        return (FarmTrial(self.client, trial) for trial in self.client.trials(self.id))

    def cancel(self) -> None:
        """Takes the job out of the queue and has its running trials stopped."""
        self.job = self.client.cancel(self.id)


@dataclass(frozen=True)
class FarmTrial:
    """A trial of a job."""

    client: ApiClient = field(repr=False)
    trial: Trial

    @property
    def succeeded(self) -> bool:
        """Whether it reached its goal."""
        return self.trial.outcome is not None and self.trial.outcome.kind is OutcomeKind.SUCCEEDED

    def log(self) -> "TrialLog":
        """The log as arrays; the file itself is not kept.

        Raises:
            ClientError: the trial has no log.
        """
        from api_schemas.trial_log_reader import read_log

        with tempfile.TemporaryDirectory(prefix="trifarm-log-") as folder:
            return read_log(self.save_log(Path(folder) / log_name(self.trial.ordinal)))

    def save_log(self, path: Path | str) -> Path:
        """Brings the log to a file, checked against its SHA-256.

        Raises:
            ClientError: the trial has no log.
        """
        if self.trial.log_sha256 is None:
            name, state = self.trial.trial_id, self.trial.state
            raise ClientError(f"trial {name} is {state} and has no log; logs come with accepted outcomes")
        return download(self.client, log_of(self.trial), Path(path), Event()).path
