"""``trifarm top``: the farm on one screen, again and again: what is wrong, what robots do, which jobs run and wait."""

import os
import sys
import time
from dataclasses import dataclass
from typing import Annotated

import typer
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from api_schemas.job import Job, JobState
from api_schemas.robot import Robot, RobotState
from api_schemas.status import FarmStatus
from api_schemas.visible import visible
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.errors import Refused, ServerAway
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import PIPE_COLUMNS, age, duration, print_document

MOST_JOBS = 12
PASSING = frozenset({429, 500, 502, 503, 504})
"""What a farm answers, or a proxy before it, while a part of it is away or too much is asked; whoever watches goes on."""
STYLES = {
    RobotState.IDLE: "green",
    RobotState.LEASED: "cyan",
    RobotState.RUNNING: "cyan",
    RobotState.DRAINING: "yellow",
    RobotState.OUT_OF_SERVICE: "red",
    RobotState.LOST: "red",
}


@dataclass(frozen=True)
class Seen:
    """The farm at one moment; running jobs stand before queued ones."""

    status: FarmStatus
    robots: tuple[Robot, ...]
    jobs: tuple[Job, ...]

    @classmethod
    def now(cls, client: ApiClient) -> "Seen":
        """As the server tells it."""
        jobs = [job for state in (JobState.RUNNING, JobState.QUEUED) for job in client.jobs(limit=MOST_JOBS, state=state).jobs]
        return cls(client.status(), client.robots(), tuple(jobs[:MOST_JOBS]))


def top(
    every_s: Annotated[float, typer.Option("--every", min=0.2, max=60.0, help="Seconds between two updates.")] = 1.0,
    once: Annotated[bool, typer.Option("--once", help="Show the farm once and end; always so if stdout is no terminal.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Watch the farm in the terminal: problems, robots, running and queued jobs. Ctrl-C ends it."""
    with ApiClient(load_connection(os.environ)) as client:
        if as_json:
            print_document(document(Seen.now(client)))
        elif once or not sys.stdout.isatty():
            width = None if sys.stdout.isatty() else PIPE_COLUMNS
            Console(file=sys.stdout, highlight=False, width=width).print(view(Seen.now(client)))
        else:
            _follow(client, every_s)


def document(seen: Seen) -> dict[str, object]:
    """What ``--json`` prints."""
    robots, jobs = ([each.model_dump(mode="json") for each in listed] for listed in (seen.robots, seen.jobs))
    return {"status": seen.status.model_dump(mode="json"), "robots": robots, "jobs": jobs}


def _follow(client: ApiClient, every_s: float) -> None:
    last = view(Seen.now(client))
    try:
        with Live(last, console=Console(highlight=False), screen=True, auto_refresh=False) as live:
            while True:
                time.sleep(every_s)
                try:
                    last = view(Seen.now(client))
                    live.update(last, refresh=True)
                except (ServerAway, Refused) as error:
                    if isinstance(error, Refused) and error.problem.status not in PASSING:
                        raise
                    why = error.detail.rstrip(".") if isinstance(error, Refused) else f"{client.url} does not answer"
                    away = Text(visible(f"{why}; what follows is old"), style="bold red")
                    live.update(Group(away, last), refresh=True)
    except KeyboardInterrupt:
        return


def view(seen: Seen) -> RenderableType:
    """The screen."""
    status = seen.status
    head = Text(f"farm {status.farm}: ", style="bold").append(
        status.summary, style="bold green" if status.healthy else "bold yellow"
    )
    oldest = "" if status.oldest_queued_s is None else f", the oldest job waits for {duration(status.oldest_queued_s)}"
    queue = Text(f"{status.trials_running} trials running, {status.trials_queued} queued{oldest}")
    problems = [Text(visible(f"! {problem}"), style="red") for problem in status.problems]
    return Group(head, queue, *problems, Text(), _robots(seen.robots), Text(), _jobs(seen.jobs))


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns[:-1]:
        table.add_column(column, no_wrap=True)
    table.add_column(columns[-1], overflow="ellipsis", no_wrap=True)
    return table


def _robots(robots: tuple[Robot, ...]) -> Table:
    table = _table("robot", "state", "trial", "at", "done", "motors", "tracker", "self-test", "reason")
    for robot in robots:
        health = robot.health
        rise_k = None if health is None else health.motor_temperature_rise_k
        confidence = None if health is None else health.tracker_confidence
        tested = None if health is None else health.self_test
        cells = (
            robot.robot,
            Text(robot.state.value, style=STYLES[robot.state]),
            robot.trial or "-",
            "-" if robot.simulated_s is None else f"{robot.simulated_s:.0f} s",
            str(robot.trials_done),
            "-" if rise_k is None else f"+{rise_k:.0f} K",
            "-" if confidence is None else f"{confidence:.2f}",
            "-" if tested is None else f"{'failed' if tested.wrong else 'passed'} {age(tested.at)} ago",
            Text(visible(robot.reason or "")),
        )
        table.add_row(*(Text(visible(cell)) if isinstance(cell, str) else cell for cell in cells))
    return table


def _jobs(jobs: tuple[Job, ...]) -> RenderableType:
    if not jobs:
        return Text("no job runs or waits")
    table = _table("job", "state", "task", "done", "succeeded", "running", "policy", "owner", "waits because")
    for job in jobs:
        done = f"{job.trials_done}/{job.trials}"
        why = job.waiting_because if not job.trials_running else None
        cells = (job.job_id, job.state.value, job.task.value, done, str(job.successes), str(job.trials_running))
        table.add_row(*(Text(visible(cell)) for cell in (*cells, job.policy_name or "-", job.owner, why or "")))
    return table
