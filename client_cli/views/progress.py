"""How far a job is: a value that each event moves on, and the sentence that tells it."""

from dataclasses import dataclass, replace
from datetime import datetime

from api_schemas.anytime import rate_sequence
from api_schemas.job import EventKind, Job, JobEvent, TaskName
from api_schemas.question import Question
from api_schemas.success_rate import SHOWN, SHOWN_LEVEL
from client_cli.terminal.output import duration


@dataclass(frozen=True)
class JobProgress:
    """A job's progress. ``running`` pairs the ordinal of each running trial with its robot.

    ``of_robots`` has for each robot the trials it has done and how many of them succeeded, as far as events told.
    """

    trials: int
    done: int = 0
    successes: int = 0
    running: tuple[tuple[int, str], ...] = ()
    started_at: str | None = None
    last_done_at: str | None = None
    waiting_because: str | None = None
    has_goals: bool = True
    of_robots: tuple[tuple[str, int, int], ...] = ()
    ended: tuple[tuple[int, bool], ...] = ()
    """The ordinal of each trial that is done, and whether it succeeded."""
    question: str | None = None
    """How the question stands that ends the job."""
    told_successes: int = 0
    """By the last event; what the next one has more is its robot's."""


def progress_of(job: Job) -> JobProgress:
    """Where a job stands before any event."""
    return JobProgress(
        trials=job.trials,
        done=job.trials_done,
        successes=job.successes,
        waiting_because=waiting_sentence(job),
        has_goals=job.task is not TaskName.IDENTIFY,
        question=None if job.question is None else question_sentence(job.question),
    )


def waiting_sentence(job: Job) -> str | None:
    """Why the job waits; nothing while its trials run, since then the bar moves."""
    return None if job.trials_running else job.waiting_because


def advance(progress: JobProgress, event: JobEvent) -> JobProgress:
    """The progress after ``event``."""
    robots = dict(progress.running)
    if event.trial_ordinal is not None:
        if event.kind in {EventKind.TRIAL_LEASED, EventKind.TRIAL_RUNNING} and event.robot:
            robots[event.trial_ordinal] = event.robot
        else:
            robots.pop(event.trial_ordinal, None)
    done = event.kind == EventKind.TRIAL_DONE
    of_robots = {robot: (trials, successes) for robot, trials, successes in progress.of_robots}
    ended = progress.ended
    if done and event.trial_ordinal is not None:
        ended = (*ended, (event.trial_ordinal, event.successes > progress.told_successes))
    if done and event.robot:
        trials, successes = of_robots.get(event.robot, (0, 0))
        of_robots[event.robot] = (trials + 1, successes + event.successes - progress.told_successes)
    return replace(
        progress,
        done=event.trials_done,
        successes=event.successes,
        running=tuple(robots.items()),
        of_robots=tuple((robot, *counts) for robot, counts in sorted(of_robots.items())),
        told_successes=event.successes,
        ended=ended,
        started_at=progress.started_at or (event.at if robots or done else None),
        last_done_at=event.at if done else progress.last_done_at,
        waiting_because=None if robots else progress.waiting_because,
    )


def counted(progress: JobProgress) -> tuple[int, int]:
    """Successes and number of the first trials that are all done: which ones end first may depend on how they end."""
    ended, trials = dict(progress.ended), 0
    while trials in ended:
        trials += 1
    return sum(ended[ordinal] for ordinal in range(trials)), trials


def rate_sentence(progress: JobProgress) -> str | None:
    """The success rate so far with an interval that holds however often one looks; None before the first trial."""
    successes, trials = counted(progress)
    if not (trials and progress.has_goals):
        return None
    low, high = (100 * bound for bound in rate_sequence(successes, trials, SHOWN_LEVEL))
    return f"{SHOWN} {low:.0f}–{high:.0f} %"


def question_sentence(question: Question) -> str:
    """How a question stands, short enough for a bar; the interval is its confidence sequence."""
    low, high = (100 * bound for bound in question.sequence_95)
    if question.gained is None:
        return f"{SHOWN} {low:.0f}–{high:.0f} %"
    return f"better on {question.gained} goals, worse on {question.lost}: {SHOWN} {low:+.0f} to {high:+.0f} points"


def estimate_s(progress: JobProgress) -> float | None:
    """Seconds of work left at the pace so far, by the server's clock; None until a trial has ended."""
    if not (progress.done and progress.started_at and progress.last_done_at):
        return None
    worked = datetime.fromisoformat(progress.last_done_at) - datetime.fromisoformat(progress.started_at)
    return worked.total_seconds() / progress.done * (progress.trials - progress.done)


def sentence(progress: JobProgress) -> str:
    """Everything but the bar, such as "11 succeeded, 4 running (robot-0 robot-1), about 12 s left"."""
    parts = [f"{progress.successes} succeeded" if progress.has_goals else f"{progress.done} recorded"]
    if (told := progress.question or rate_sentence(progress)) is not None:
        parts.append(told)
    if progress.running:
        names = sorted({robot for _, robot in progress.running})
        shown = " ".join(names[:4]) + (" …" if len(names) > 4 else "")
        parts.append(f"{len(progress.running)} running ({shown})")
    if progress.waiting_because and progress.done < progress.trials:
        parts.append(f"waiting: {progress.waiting_because}")
    left = estimate_s(progress)
    if left is not None and progress.done < progress.trials:
        parts.append(f"about {duration(left)} left")
    return ", ".join(parts)
