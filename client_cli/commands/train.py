"""``trifarm train``: from a recipe to a policy that can be submitted."""

from pathlib import Path
from typing import Annotated

import typer

from client_cli.embedded.child_process import module_command
from client_cli.terminal.errors import ClientError
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.foreground import how_it_ended, run_to_end
from client_cli.terminal.options import JsonOption

TRAINING = "sim_backend.training"
TRACKER, TRACKER_TRAINING = "tracker", "sim_backend.vision.train_tracker"
"""What is trained in a recipe's place: the network of the tracker on images."""
ENDS = (ExitCode.OK, ExitCode.OTHER, ExitCode.USAGE, ExitCode.INTERRUPTED)


def train(
    recipe: Annotated[str, typer.Argument(metavar="RECIPE", help="Name of a shipped recipe, a TOML file, or 'tracker'.")],
    *,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder of the run; by default train-RECIPE.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the checkpoint in the folder.")] = False,
    threads: Annotated[int | None, typer.Option("--threads", metavar="N", min=1, help="Number of cores; by default all.")] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", metavar="N", min=0, help="Number of workers that roll out; 0 is this process.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option("--cluster", metavar="ADDRESS", help="Ray that has the workers: 'local' or HOST:PORT.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Train a policy from a recipe in many parallel simulations, or the network of the tracker on images."""
    flags = [*(["--out", str(out)] if out else []), *(["--resume"] if resume else [])]
    flags += ["--threads", str(threads)] if threads else []
    flags += [*(["--workers", str(workers)] if workers is not None else []), *(["--cluster", cluster] if cluster else [])]
    flags += ["--json"] if as_json else []
    command = module_command(TRACKER_TRAINING, *flags) if recipe == TRACKER else module_command(TRAINING, recipe, *flags)
    code = run_to_end(command, "'train' has been stopped; with --resume it goes on from its checkpoint")
    if code not in ENDS:
        raise ClientError(f"'train' {how_it_ended(code)}")
    raise typer.Exit(code)
