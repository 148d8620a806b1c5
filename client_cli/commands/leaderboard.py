"""``trifarm leaderboard``: which policy does a task best on this farm, and which others cannot be told from it."""

import os
from typing import Annotated

import typer

from api_schemas.leaderboard import BoardRow, Leaderboard
from api_schemas.physics import ObjectName
from api_schemas.success_rate import SHOWN
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.options import AskedTask, JsonOption, ObjectOption, ObjectScaleOption
from client_cli.terminal.output import counted, print_document, print_line, print_table

COLUMNS = ("place", "policy", "letters", "rate", SHOWN, "succeeded", "jobs", "user")
TaskArgument = Annotated[AskedTask, typer.Argument(metavar="TASK", help="Task of the robot.")]
PhysicsOption = Annotated[
    int | None, typer.Option("--physics", min=1, help="Number of an earlier physics of the farm; by default the one that it has.")
]


def leaderboard(
    task: TaskArgument,
    *,
    thing: ObjectOption = ObjectName.CUBE,
    scale: ObjectScaleOption = 1.0,
    physics: PhysicsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show the policies of a task by the lower bound of their success rate, over all jobs whose goals nobody could know."""
    with ApiClient(load_connection(os.environ)) as client:
        shown = client.leaderboard(task, thing, scale, physics)
    if as_json:
        print_document(shown)
        return
    print_line(_head(shown))
    print_table(COLUMNS, (_row(row) for row in shown.rows))
    if any(row.letters for row in shown.rows):
        print_line("entries that share a letter cannot be told apart, at every look; any false difference has a chance of 5 %")


def _head(shown: Leaderboard) -> str:
    on = "no robot has told its physics" if shown.physics is None else f"{shown.physics.name} physics no. {shown.physics.number}"
    policies = "1 policy" if shown.policies == 1 else f"{shown.policies} policies"
    return f"{shown.task.value} on farm {shown.farm}: {policies}, {on}"


def _row(row: BoardRow) -> tuple[object, ...]:
    low, high = row.interval_95
    name = row.policy_name or (row.policy or "another user's recipe")[:21]
    if row.training_seeds is not None:
        name = f"{'recipe ' + row.recipe if row.recipe else name} ({counted(row.training_seeds, 'seed')})"
    succeeded = f"{row.successes}/{row.trials}"
    interval = f"{100 * low:.0f}–{100 * high:.0f} %"
    return row.rank, name, row.letters, f"{100 * row.success_rate:.0f} %", interval, succeeded, row.jobs, row.owner
