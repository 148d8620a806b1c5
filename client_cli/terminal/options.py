"""Arguments and options that several commands share, so that they read the same everywhere."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from api_schemas.job import POLICY_TASKS, JobPriority, TaskName
from api_schemas.physics import LARGEST_SCALE, SMALLEST_SCALE, ObjectName
from client_cli.embedded.robot_count import MOST, of_this_machine

AUTO = "auto"

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout; progress goes to stderr.")]
JobArgument = Annotated[str, typer.Argument(metavar="ID", help="Job id, as printed by submit.")]
ManifestOption = Annotated[
    Path | None,
    typer.Option(
        "--manifest", metavar="FILE", help="Manifest of the policy; by default the path of its weights with the suffix .json."
    ),
]
LayoutOption = Annotated[
    str | None,
    typer.Option("--layout", metavar="NAME", help="A ready-made manifest by its name; 'trifarm layouts' lists them."),
]


AskedTask = Literal[
    TaskName.PUSH,
    TaskName.LIFT,
    TaskName.REACH,
    TaskName.FLOOR_POSE,
    TaskName.MOVE_CUBE_1,
    TaskName.MOVE_CUBE_2,
    TaskName.MOVE_CUBE_3,
    TaskName.MOVE_CUBE_4,
]
"""The tasks that a policy can be asked to do, which leaves out ``identify``."""
TriedTaskOption = Annotated[
    AskedTask | None,
    typer.Option("--task", metavar="NAME", help="Task of the short trials that follow; by default by the manifest's goal."),
]
TryOption = Annotated[
    bool, typer.Option("--try/--no-try", help="Whether the policy is tried in 20 short trials in a small nominal simulation.")
]
TaskOption = Annotated[AskedTask, typer.Option("--task", metavar="|".join(POLICY_TASKS), help="Task of the robot.")]
LikeTaskOption = Annotated[
    AskedTask | None,
    typer.Option("--task", metavar="|".join(POLICY_TASKS), help="Task of the robot; a job like another takes that one's."),
]
ObjectOption = Annotated[ObjectName, typer.Option("--object", help="Object between the fingers; goals stay those of the cube.")]
ObjectScaleOption = Annotated[
    float,
    typer.Option(
        "--object-scale", min=SMALLEST_SCALE, max=LARGEST_SCALE, help="Size of the object, as a multiple of its usual size."
    ),
]
PriorityOption = Annotated[
    JobPriority, typer.Option("--priority", help="low runs after all other jobs; high runs first (operators only).")
]
ImagesOption = Annotated[
    bool, typer.Option("--images", help="Keep in each log what the robot's three cameras saw; the farm's robots need to render.")
]
WaitOption = Annotated[bool, typer.Option("--wait", help="Follow the job to its end.")]
IdempotencyKeyOption = Annotated[
    str | None,
    typer.Option("--idempotency-key", metavar="TEXT", help="Repeated requests with the same key make one job."),
]
WebhookOption = Annotated[
    str | None,
    typer.Option("--webhook", metavar="URL", help="https address that the farm calls when the job ends; not for a folder."),
]
NameOption = Annotated[str | None, typer.Option("--name", metavar="TEXT", help="What the job is called, in lists and on pages.")]
NoteOption = Annotated[str | None, typer.Option("--note", metavar="TEXT", help="What is to be remembered of the job.")]


def _count_of_robots(said: str | int) -> int:
    if said == AUTO:
        return of_this_machine()
    number = str(said)
    if not (number.isascii() and number.isdigit() and 1 <= int(number) <= MOST):
        raise typer.BadParameter(f"{said!r} is neither a number from 1 to {MOST} nor '{AUTO}'.")
    return int(number)


RobotsOption = Annotated[
    int,
    typer.Option(
        "--robots",
        parser=_count_of_robots,
        metavar=f"N|{AUTO}",
        help=f"Number of simulated robots, 1 to {MOST}; '{AUTO}' takes two a core, as far as memory goes.",
    ),
]
