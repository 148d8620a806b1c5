"""Arguments and options that several commands share, so that they read the same everywhere."""

from pathlib import Path
from typing import Annotated

import typer

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
RobotsOption = Annotated[int, typer.Option("--robots", min=1, max=64, help="How many simulated robots.")]
PhysicsOption = Annotated[str, typer.Option("--physics", help="The robots' physics; nominal gives each the same, ideal one.")]
