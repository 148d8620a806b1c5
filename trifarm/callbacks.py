"""A training tries its policy on a farm as it goes: callbacks for stable-baselines3 and for runners of rsl_rl."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self

from api_schemas.job import TaskName
from api_schemas.report import Report
from client_cli.terminal.errors import ClientError
from client_cli.terminal.output import note
from trifarm.evaluation import Evaluation, evaluate

__all__ = ["Evaluated", "Evaluations", "evaluate_runner"]
Record = Callable[[str, float], None]


@dataclass(frozen=True)
class Evaluated:
    """A policy of a training after ``step``, and what the farm said of it: a report, or why there is none."""

    step: int
    report: Report | None
    problem: str | None = None


@dataclass
class Evaluations:
    """The evaluations of one training, one at a time: while one goes on, the next is left out and not queued.

    Owner of the handle of the one that goes on. ``found`` are those that are over, in the order of their steps.
    """

    task: TaskName | str
    every: int
    asked: dict[str, Any]
    found: list[Evaluated] = field(default_factory=list)
    skipped: list[int] = field(default_factory=list)
    _running: Evaluation | None = None
    _last: int = 0

    def begin_at(self, step: int) -> None:
        """A training that begins, anew or further on."""
        self._last = step

    def look(self, step: int, model: Any, env: Any, record: Record) -> None:
        """Records what has come in, and begins the next evaluation when its step has come."""
        if self._running is not None and self._running.done:
            self._take(record)
        if step - self._last < self.every:
            return
        self._last = step
        if self._running is not None:
            self.skipped.append(step)
            return
        try:
            self._running = evaluate(model, self.task, env=env, step=step, **self.asked)
        except ClientError as error:
            self._fail(step, str(error))

    def finish(self, record: Record, timeout_s: float | None = None) -> None:
        """Waits for the one that goes on, and records it."""
        if self._running is not None:
            try:
                self._running.result(timeout_s)
            except ClientError:
                pass  # recorded as what it is
            except TimeoutError:
                self._running.cancel()
                return
            self._take(record)

    def _take(self, record: Record) -> None:
        assert self._running is not None and self._running.step is not None, "there is one"
        ended, self._running = self._running, None
        step = int(ended.step or 0)
        try:
            report = ended.result(0)
        except Exception as error:  # a training does not end because a farm is away
            self._fail(step, str(error))
            return
        self.found.append(Evaluated(step, report))
        low, high = report.interval_80
        told = {"success_rate": report.success_rate, "low_80": low, "high_80": high, "trials": report.trials, "of_step": step}
        for name, value in told.items():
            record(f"farm/{name}", value)

    def _fail(self, step: int, problem: str) -> None:
        self.found.append(Evaluated(step, None, problem))
        note(f"the policy of step {step} was not evaluated: {problem}")


@dataclass
class RunnerEvaluations:
    """The evaluations of a runner of rsl_rl, as a context manager around ``learn``; ``found`` are those that are over."""

    runner: Any
    evaluations: Evaluations
    env: Any
    timeout_s: float | None = None
    _restore: Callable[[], None] | None = None

    @property
    def found(self) -> list[Evaluated]:
        """What the farm has said so far."""
        return self.evaluations.found

    def __enter__(self) -> Self:
        owner = self.runner.logger if hasattr(getattr(self.runner, "logger", None), "log") else self.runner
        log = owner.log

        def log_and_look(*given: Any, **named: Any) -> Any:
            answer = log(*given, **named)
            iteration = named["it"] if "it" in named else given[0]["it"]
            self.evaluations.look(iteration + 1, self.runner, self.env, self._record)
            return answer

        owner.log = log_and_look
        self._restore = lambda: setattr(owner, "log", log)
        return self

    def __exit__(self, kind: type | None, *_details: object) -> None:
        if self._restore is not None:
            self._restore()
        if kind is None:
            self.evaluations.finish(self._record, self.timeout_s)

    def _record(self, name: str, value: float) -> None:
        writer = getattr(getattr(self.runner, "logger", self.runner), "writer", None)
        if writer is not None:
            writer.add_scalar(name, value, self.runner.current_learning_iteration)


def evaluate_runner(
    runner: Any, task: TaskName | str, *, every: int, env: Any = None, timeout_s: float | None = None, **asked: Any
) -> RunnerEvaluations:
    """Has a runner of rsl_rl try its policy on a farm every so many iterations, while it goes on learning.

    Results are written to the runner's log as ``farm/success_rate``, ``farm/low_80``, ``farm/high_80``, ``farm/trials`` and
    ``farm/of_step``, the iteration that they are of. One evaluation goes on at a time; the end of the block waits for the last.

    Args:
        runner: of rsl_rl, whose environment is trifarm's.
        task: what is asked of the robots.
        every: iterations between evaluations.
        env: the environment; by default the runner's.
        timeout_s: how long the end waits; afterwards the job is cancelled.
        **asked: as for ``evaluate``, such as ``trials``, ``seed``, ``until_known`` or ``farm``.

    Example:
        >>> import trifarm
        >>> def learn(runner):
        ...     with trifarm.evaluate_runner(runner, "push", every=50, trials=20, seed=1) as evaluations:
        ...         runner.learn(200)
        ...     return [(each.step, each.report.success_rate) for each in evaluations.found if each.report]
    """
    return RunnerEvaluations(runner, Evaluations(task, every, asked), runner.env if env is None else env, timeout_s)
