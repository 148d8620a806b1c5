"""Arguments and options that several commands share, so that they read the same everywhere."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from api_schemas.job import POLICY_TASKS, JobPriority, TaskName
from api_schemas.physics import LARGEST_SCALE, SMALLEST_SCALE, ObjectName

JsonOption = Annotated[bool, typer.Option("--json", help="Print exactly one JSON document on stdout; progress goes to stderr.")]
JobArgument = Annotated[str, typer.Argument(metavar="ID", help="The job's id, as submit printed it.")]
ManifestOption = Annotated[
    Path | None,
    typer.Option("--manifest", metavar="FILE", help="The policy's manifest; without it, FILE with the suffix .json."),
]
LayoutOption = Annotated[
    str | None,
    typer.Option("--layout", metavar="NAME", help="A ready-made manifest: rrc2022-push, rrc2022-lift, keypoints or pose."),
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
TaskOption = Annotated[AskedTask, typer.Option("--task", metavar="|".join(POLICY_TASKS), help="What is asked of the robot.")]
ObjectOption = Annotated[
    ObjectName, typer.Option("--object", help="What lies between the fingers; goals stay those of the cube.")
]
ObjectScaleOption = Annotated[
    float, typer.Option("--object-scale", min=SMALLEST_SCALE, max=LARGEST_SCALE, help="Times the object's usual size.")
]
PriorityOption = Annotated[
    JobPriority, typer.Option("--priority", help="low waits behind the rest; high goes before it, for operators alone.")
]
WaitOption = Annotated[bool, typer.Option("--wait", help="Follow the job to its end.")]
IdempotencyKeyOption = Annotated[
    str | None,
    typer.Option("--idempotency-key", metavar="TEXT", help="The same key and the same job make one job, however often sent."),
]
WebhookOption = Annotated[
    str | None, typer.Option("--webhook", metavar="URL", help="An https address that the farm calls at the job's end, if it may.")
]
RobotsOption = Annotated[int, typer.Option("--robots", min=1, max=64, help="How many simulated robots.")]
