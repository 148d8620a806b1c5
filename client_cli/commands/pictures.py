"""``trifarm look`` and ``trifarm video``: what a robot's three cameras saw in a trial, from its log."""

from pathlib import Path
from typing import Annotated

import typer

from client_cli.embedded.child_process import module_command
from client_cli.terminal.child_answer import answer_of, pass_on
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.options import JsonOption

VISION = "sim_backend.vision"

LogArgument = Annotated[Path, typer.Argument(metavar="LOG", help="Log of a trial, such as trial-000.mcap.")]
DrawnOption = Annotated[bool, typer.Option("--drawn", help="Draw what was measured, even where the log keeps images.")]
EdgesOption = Annotated[bool, typer.Option("--edges", help="Draw the edges of the tracked object into the views.")]


def look(
    log: LogArgument,
    *,
    at: Annotated[float, typer.Option("--at", metavar="SECONDS", min=0.0, help="Moment since the trial's start.")] = 0.0,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Picture to write, .png or .jpg.")] = Path("view.png"),
    drawn: DrawnOption = False,
    edges: EdgesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write the three views of a moment: images that the log keeps, else what was measured, drawn."""
    _run("look", log, out, ["--at", str(at), *_flags(drawn=drawn, edges=edges, as_json=as_json)])


def video(
    log: LogArgument,
    *,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Film to write, .mp4 or .webm.")] = Path("trial.mp4"),
    rate: Annotated[float, typer.Option("--rate", metavar="HZ", min=1.0, max=100.0, help="Frames a second.")] = 10.0,
    drawn: DrawnOption = False,
    edges: EdgesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write a film of a trial's three views (VP9): images that the log keeps, else what was measured, drawn."""
    _run("video", log, out, ["--rate", str(rate), *_flags(drawn=drawn, edges=edges, as_json=as_json)])


def _flags(*, drawn: bool, edges: bool, as_json: bool) -> list[str]:
    return ["--drawn"] * drawn + ["--edges"] * edges + ["--json"] * as_json


def _run(command: str, log: Path, out: Path, flags: list[str]) -> None:
    if not log.is_file():
        raise UsageProblem(f"there is no file {log}")
    if not out.resolve().parent.is_dir():
        raise UsageProblem(f"there is no folder {out.resolve().parent} for {out}")
    pass_on(command, answer_of(module_command(VISION, command, str(log), "--out", str(out), *flags)))
