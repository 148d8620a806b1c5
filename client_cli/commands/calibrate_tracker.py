"""``trifarm calibrate-tracker``: how far the tracker on images is off in simulation, as ranges of the formula's effects."""

from pathlib import Path
from typing import Annotated

import typer

from client_cli.embedded.child_process import module_command
from client_cli.terminal.errors import ClientError
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.foreground import how_it_ended, run_to_end
from client_cli.terminal.options import JsonOption

CALIBRATING = "sim_backend.vision.calibrate_tracker"
ENDS = (ExitCode.OK, ExitCode.OTHER, ExitCode.USAGE, ExitCode.INTERRUPTED)


def calibrate_tracker(
    *,
    rows: Annotated[
        Path, typer.Option("--rows", metavar="FILE", help="Measured errors, one line a scene; those that are there are kept.")
    ] = Path("tracker-errors.jsonl"),
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Ranges to write, for --physics.")] = Path("real-2.toml"),
    robots: Annotated[int, typer.Option("--robots", metavar="N", min=2, help="Number of robots.")] = 24,
    scenes: Annotated[int, typer.Option("--scenes", metavar="N", min=2, help="Number of scenes of each.")] = 8,
    figure: Annotated[
        Path | None, typer.Option("--figure", metavar="FILE", help="Figure of the error distributions, .svg or .png.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure the tracker on images in simulation, and write the ranges that the formula's effects get from it."""
    flags = ["--rows", str(rows), "--out", str(out), "--robots", str(robots), "--scenes", str(scenes)]
    flags += [] if figure is None else ["--figure", str(figure)]
    code = run_to_end(
        module_command(CALIBRATING, *flags, *(["--json"] if as_json else [])),
        "'calibrate-tracker' has been stopped; called again with the same --rows it goes on",
    )
    if code not in ENDS:
        raise ClientError(f"'calibrate-tracker' {how_it_ended(code)}")
    raise typer.Exit(code)
