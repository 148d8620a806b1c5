"""A farm for programs: submits a policy, waits for its report, goes through its trials, reads a log as arrays."""

import os
import tempfile
import uuid
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Self

from api_schemas.job import POLICY_TASKS, Job, JobPriority, JobState, TaskName
from api_schemas.physics import ObjectName
from api_schemas.report import Report
from api_schemas.share import USUAL_DAYS, NewShare, Share
from api_schemas.trial import OutcomeKind, Trial
from client_cli.commands.asking import Asking
from client_cli.commands.report import write_page, write_print
from client_cli.commands.share import wish_to_share
from client_cli.commands.submission import prepare
from client_cli.connection.api_client import ApiClient, log_of
from client_cli.connection.log_download import download, log_name
from client_cli.connection.settings import load_connection
from client_cli.terminal.errors import ClientError, UsageProblem, files_checked
from client_cli.views.following import follow_to_end
from trifarm.wording import worded

if TYPE_CHECKING:
    from trifarm.log import Log

ARGUMENTS = {"max": "max_trials"}
"""Arguments of ``Farm.submit`` that are called otherwise than options of ``trifarm submit``."""
REPORT_WRITERS = {".html": write_page, ".pdf": write_print}


class Farm:
    """A connection to a farm; use it as a context manager.

    Args:
        url: where it is; without it as for the command line: ``TRIFARM_URL``, or what ``trifarm up`` wrote.
        token: who asks; without it as for the command line, which shows a stored token to its own farm alone.

    Raises:
        ClientError: an address or a token that cannot be used.

    Example:
        >>> import trifarm
        >>> with trifarm.Farm() as farm:
        ...     job = farm.submit("push.safetensors", task="push", trials=2, seed=1)
        ...     report = job.wait()
        ...     for trial in job.trials():
        ...         trial.save_log(f"trial-{trial.trial.ordinal:03}.mcap")
        PosixPath('trial-000.mcap')
        PosixPath('trial-001.mcap')
        >>> report.trials
        2
    """

    def __init__(self, url: str | None = None, token: str | None = None) -> None:
        self._client = ApiClient(load_connection(os.environ, url, token))

    def __enter__(self) -> Self:
        self._client.__enter__()
        return self

    def __exit__(self, *details: object) -> None:
        self._client.__exit__(*details)

    def close(self) -> None:
        """Ends its connections, where no ``with`` does."""
        self._client.__exit__(None, None, None)

    def submit(
        self,
        weights: Path | str,
        *,
        task: TaskName | str | None = None,
        trials: int | None = None,
        seed: int | None = None,
        layout: str | None = None,
        manifest: Path | str | None = None,
        object: ObjectName | str = ObjectName.CUBE,
        object_scale: float = 1.0,
        priority: JobPriority | str = JobPriority.NORMAL,
        webhook: str | None = None,
        against: str | None = None,
        bar: float | None = None,
        until_known: bool = False,
        max_trials: int | None = None,
        at_least: float | None = None,
        like: str | None = None,
        goals: Path | str | None = None,
        images: bool = False,
        recipe: str | None = None,
        training_seed: int | None = None,
        name: str | None = None,
        note: str | None = None,
        idempotency_key: str | None = None,
    ) -> "FarmJob":
        """Uploads a policy and queues a job of it.

        What the farm's dry run found strange, or that the policy is of another task, is a ``UserWarning`` before the job is
        queued; nothing is refused for it.

        Args:
            weights: a .safetensors, .onnx or stable-baselines3 .zip file; for operators also builtin:grasp or builtin:grasp-turn.
            task: what is asked of the robots; a job like another has that one's.
            trials: how many goals are tried, 40 by default.
            seed: draws the goals and each trial's order of robots, so that jobs of one seed compare; drawn by the farm if absent.
            layout: a ready-made manifest by its name.
            manifest: the manifest's file; without it and a layout, the one beside the weights.
            object: what lies between the fingers.
            object_scale: times the object's usual size.
            priority: low waits behind the rest; high goes before it, for operators alone.
            webhook: an https address that the farm calls at the job's end, where it may.
            against: with ``until_known``, a job, or a policy (its file, its digest, or builtin:NAME) to compare with.
            bar: with ``until_known``, a success rate to compare with.
            until_known: end the job when it is known whether it is better, or at the budget.
            max_trials: the most goals that may be tried until then, 200 by default.
            at_least: the smallest difference that matters.
            like: a job whose task, goals and orders of robots are taken.
            goals: a file of goals of one's own, a JSON list.
            images: whether the logs keep what the robot's three cameras saw.
            recipe: the training that the policy is one seed of; several seeds are one entry of boards and comparisons.
            training_seed: which seed of it.
            name: what to call the job, in lists and reports.
            note: what one wants to remember of it.
            idempotency_key: asked again with the same key the farm gives the job that it has; drawn if None.

        Raises:
            ClientError: the policy cannot be used, or the farm refused it; the text says why.
        """
        if task is not None and task not in POLICY_TASKS:
            raise UsageProblem(f"there is no task {str(task)!r} for a policy; choose from {', '.join(POLICY_TASKS)}")
        common = {"task": task, "seed": seed, "object": object, "object_scale": object_scale, "priority": priority}
        common |= {"recipe": recipe, "training_seed": training_seed, "webhook": webhook, "images": images}
        common |= {"name": name, "note": note}
        asking = Asking(against, bar, until_known, max_trials, at_least, like, None if goals is None else Path(goals))
        beside = None if manifest is None else Path(manifest)
        with files_checked(), worded(ARGUMENTS):
            made = prepare(self._client, Path(weights), asking, common, trials=trials, manifest=beside, layout=layout)
        for text in made.warnings:
            warnings.warn(text, stacklevel=2)
        return FarmJob(self._client, self._client.create_job(made.wish, idempotency_key or uuid.uuid4().hex))

    def job(self, job_id: str) -> "FarmJob":
        """A job by its id."""
        return FarmJob(self._client, self._client.job(job_id))

    def jobs(self, *, limit: int = 50, state: JobState | None = None) -> tuple["FarmJob", ...]:
        """The newest jobs."""
        return tuple(FarmJob(self._client, job) for job in self._client.jobs(limit=limit, state=state).jobs)

    def share(self, what: "FarmJob | FarmTrial | str", *, at_s: float | None = None, days: float = USUAL_DAYS) -> NewShare:
        """A link to the report of a job, or to the replay of a trial, for whoever has no token; ``url`` is told this once.

        The farm must allow links (``TRIFARM_SHARES=true``). They show what robots measured, never truth.

        Args:
            what: the job or the trial, or the id of one.
            at_s: the moment of a trial at which its replay opens.
            days: after so many the link leads nowhere, at most 90.

        Raises:
            ClientError: the farm has no such thing or allows no links, or a value cannot be used; the text says which.

        Example:
            >>> import trifarm
            >>> with trifarm.Farm() as farm:
            ...     trial = next(farm.jobs(limit=1)[0].trials())
            ...     shared = farm.share(trial, at_s=2.7, days=1)
            ...     farm.revoke_share(shared)
            ...     farm.shares()[0].is_open
            False
        """
        named = what.id if isinstance(what, FarmJob) else what.trial.trial_id if isinstance(what, FarmTrial) else what
        return self._client.share(wish_to_share(named, at_s=at_s, days=days))

    def shares(self) -> tuple[Share, ...]:
        """Links that one made and links to one's jobs, newest first, those that are over included; none tells its address."""
        return self._client.shares()

    def revoke_share(self, share: Share | str) -> None:
        """Ends a link, or the one of this id: its address is answered 404 from then on.

        Raises:
            ClientError: there is none.
        """
        self._client.revoke_share(share if isinstance(share, str) else share.share_id)


@dataclass
class FarmJob:
    """A job of a farm; ``job`` is what was last heard of it.

    Example:
        >>> import trifarm
        >>> with trifarm.Farm() as farm:
        ...     newest = farm.jobs(limit=1)[0]
        ...     newest.job.state.value
        'succeeded'
    """

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
        report = self.client.known_report(self.id)
        if not isinstance(report, Report):
            raise ClientError(f"job {self.id} is an identification; 'trifarm report {self.id} --json' shows what it recorded")
        return report

    def save_report(self, path: Path | str) -> None:
        """Writes the report: a .html file is one signed page, which ``trifarm verify`` checks, a .pdf file is for print.

        Raises:
            ClientError: there is no report, or the file has another ending or cannot be written.
        """
        write = REPORT_WRITERS.get(Path(path).suffix.lower())
        if write is None:
            raise UsageProblem(f"a report is written as {' or '.join(REPORT_WRITERS)}, and {str(path)!r} is neither")
        with files_checked():
            write(self.client, self.id, Path(path))

    def trials(self) -> Iterator["FarmTrial"]:
        """The trials in their order."""
        return (FarmTrial(self.client, trial) for trial in self.client.trials(self.id))

    def cancel(self) -> None:
        """Takes the job out of the queue and has its running trials stopped."""
        self.job = self.client.cancel(self.id)


@dataclass(frozen=True)
class FarmTrial:
    """A trial of a job.

    Example:
        >>> import trifarm
        >>> with trifarm.Farm() as farm:
        ...     first = next(farm.jobs(limit=1)[0].trials())
        ...     first.log().metadata["task"]
        'push'
    """

    client: ApiClient = field(repr=False)
    trial: Trial

    @property
    def succeeded(self) -> bool:
        """Whether it reached its goal."""
        return self.trial.outcome is not None and self.trial.outcome.kind is OutcomeKind.SUCCEEDED

    def log(self) -> "Log":
        """The log as arrays; the file itself is not kept.

        Raises:
            ClientError: the trial has no log, or it cannot be read.
        """
        from trial_logs.reader import LogUnreadableError
        from trifarm.log import read_log

        with tempfile.TemporaryDirectory(prefix="trifarm-log-") as folder:
            try:
                return read_log(self.save_log(Path(folder) / log_name(self.trial.ordinal)))
            except LogUnreadableError as error:
                raise ClientError(str(error)) from error

    def save_log(self, path: Path | str) -> Path:
        """Brings the log to a file, checked against its SHA-256.

        Raises:
            ClientError: the trial has no log, or the file cannot be written.
        """
        if self.trial.log_sha256 is None:
            name, state = self.trial.trial_id, self.trial.state
            raise ClientError(f"trial {name} is {state} and has no log; logs come with accepted outcomes")
        with files_checked():
            return download(self.client, log_of(self.trial), Path(path), Event()).path
