"""A policy is tried on a farm while the program goes on: in a training loop, or with several policies at once."""

import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Thread
from typing import Any

from api_schemas.job import FINAL_JOB_STATES, Job, TaskName
from api_schemas.report import Report
from client_cli.terminal.errors import ServerAway, UsageProblem
from client_cli.views.following import GIVE_UP_AFTER_S
from trifarm.farm import Farm, FarmJob

__all__ = ["Evaluation", "evaluate"]
LOOK_EVERY_S = 1.0


@dataclass
class Evaluation:
    """A policy that is being tried; owned by a thread of its own until it is done.

    ``job`` is what was last heard, None before the farm has it. ``step`` is what the caller calls this policy by.
    """

    step: float | None = None
    job: Job | None = None
    _report: Report | None = None
    _problem: Exception | None = None
    _ended: Event = field(default_factory=Event)
    _stop: Event = field(default_factory=Event)

    @property
    def done(self) -> bool:
        """Whether ``result`` has an answer, a report or an error."""
        return self._ended.is_set()

    @property
    def progress(self) -> tuple[int, int]:
        """Trials done, and the most that there may be; both 0 before the farm has the job."""
        return (0, 0) if self.job is None else (self.job.trials_done, self.job.trials)

    def result(self, timeout_s: float | None = None) -> Report:
        """The report, after waiting for it; with ``until_known`` its ``question`` says what is known.

        Raises:
            TimeoutError: it was not there in time; ask again.
            ClientError: the policy cannot be used, the job failed or was cancelled, or the farm is away.
        """
        if not self._ended.wait(timeout_s):
            raise TimeoutError(f"{self.progress[0]} of {self.progress[1]} trials are done after {timeout_s:g} s; ask again")
        if self._problem is not None:
            raise self._problem
        assert self._report is not None, "it has ended without a problem"
        return self._report

    def cancel(self) -> None:
        """Has the job cancelled; ``result`` then says so."""
        self._stop.set()


def evaluate(
    policy: Any,
    task: TaskName | str,
    trials: int | None = None,
    *,
    env: Any = None,
    until_known: float | str | Path | None = None,
    at_least: float | None = None,
    farm: Farm | str | None = None,
    step: float | None = None,
    on_end: Callable[[Evaluation], None] | None = None,
    **asked: Any,
) -> Evaluation:
    """Has a policy tried on a farm and returns at once; ``result`` of what it gives waits for the report.

    A model is saved before it returns, so that training may go on changing it. Errors of the farm come with ``result``.

    Args:
        policy: a file, as for ``Farm.submit``; or with ``env`` what ``save_policy`` takes.
        task: what is asked of the robots.
        trials: how many goals are tried, 40 by default; with ``until_known`` the most, 200 by default.
        env: the environment of a model.
        until_known: end when it is known whether the success rate is above this number, or whether the policy is better than
            this one: a job, or a policy's file or digest.
        at_least: the smallest difference from the other policy that matters.
        farm: a ``Farm`` that stays open meanwhile, or where one is; by default as for ``Farm``: ``TRIFARM_URL``, or what
            ``trifarm up`` wrote.
        step: what to call this policy by, such as its training step.
        on_end: called in the evaluation's own thread when it is done.
        **asked: whatever else ``Farm.submit`` takes, such as ``seed``, ``recipe`` or ``priority``.

    Raises:
        ClientError: the model cannot be saved.

    Example:
        >>> import trifarm
        >>> going_on = trifarm.evaluate("push.safetensors", "push", trials=2, seed=1)
        >>> report = going_on.result()  # whatever else there is to do comes before this
        >>> going_on.done, report.trials
        (True, 2)
    """
    question = _question(until_known, at_least, trials)
    handle = Evaluation(step)
    folder = tempfile.TemporaryDirectory(prefix="trifarm-evaluate-")
    try:
        weights = _saved(policy, env, Path(folder.name))
    except BaseException:
        folder.cleanup()
        raise

    def run() -> None:
        try:
            with folder, ExitStack() as opened:
                connection = farm if isinstance(farm, Farm) else opened.enter_context(Farm(farm))
                handle._report = _followed(connection.submit(weights, task=task, **question, **asked), handle)
        except Exception as error:  # whoever asks for the result hears of it
            handle._problem = error
        finally:
            handle._ended.set()
            if on_end is not None:
                on_end(handle)

    Thread(target=run, name="trifarm-evaluate", daemon=True).start()
    return handle


def _question(known: float | str | Path | None, at_least: float | None, trials: int | None) -> dict[str, Any]:
    """What is asked of ``Farm.submit``."""
    if known is None:
        if at_least is not None:
            raise UsageProblem("at_least is a difference from another policy; name that one with until_known")
        return {"trials": trials}
    if isinstance(known, bool):
        raise UsageProblem("until_known is a success rate such as 0.8, or the policy or job to compare with")
    to_find = {"bar": float(known)} if isinstance(known, int | float) else {"against": str(known)}
    return {"until_known": True, "max_trials": trials, "at_least": at_least, **to_find}


def _saved(policy: Any, env: Any, folder: Path) -> Path | str:
    """The policy's file, or its name as it stands."""
    if isinstance(policy, str | Path):
        if env is not None:
            raise UsageProblem("env is the environment of a model; a file has its manifest beside it")
        return policy
    if env is None:
        raise UsageProblem(f"a {type(policy).__name__} is saved with its environment's manifest: name it with env=")
    from trifarm.saving import save_policy

    return save_policy(policy, env, folder / "evaluated").weights


def _followed(job: FarmJob, handle: Evaluation) -> Report:
    """The report of a job, through lost connections."""
    handle.job, heard_at_s, cancelled = job.job, time.monotonic(), False
    while handle.job.state not in FINAL_JOB_STATES:
        if handle._stop.wait(0 if cancelled else LOOK_EVERY_S) and not cancelled:
            job.cancel()
            cancelled = True
        elif cancelled:
            time.sleep(LOOK_EVERY_S)
        try:
            handle.job, heard_at_s = job.refresh(), time.monotonic()
        except ServerAway:
            if time.monotonic() - heard_at_s > GIVE_UP_AFTER_S:
                raise
    return job.report()
