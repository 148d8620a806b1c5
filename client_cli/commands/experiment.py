"""``trifarm experiment``: tries a paper's claim on a farm of its own, and goes on where the last time stopped."""

from pathlib import Path
from typing import Annotated

import typer

from client_cli.embedded.child_process import clone_command
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.foreground import how_it_ended, run_to_end
from client_cli.terminal.options import JsonOption
from client_cli.terminal.wrong_values import meant

EXPERIMENTS = "experiments"
NAMES = (
    *("observations", "randomization", "demonstrations", "memory", "ablation", "consecutive", "objects"),
    *("observations-again", "demonstrations-again", "ablation-again", "objects-again"),
)
"""Those of ``experiments/catalogue``, which is not imported here: it is a program of its own."""
ENDS_WITHIN_S = 40.0
"""After Ctrl-C: trainings get 30 s to leave a checkpoint, and a farm's folder takes some to be removed."""
ENDS = (ExitCode.OK, ExitCode.OTHER, ExitCode.USAGE, ExitCode.INTERRUPTED)


def experiment(
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help=f"Experiment: {', '.join(NAMES[:-1])} or {NAMES[-1]}; optional with --list."),
    ] = None,
    *,
    quick: Annotated[
        bool, typer.Option("--quick", help="Smoke test with one seed, two cells and few samples, in a temporary folder.")
    ] = False,
    list_pieces: Annotated[bool, typer.Option("--list", help="Only list finished and missing parts with the time left.")] = False,
    only: Annotated[str | None, typer.Option("--only", metavar="CELL", help="Run only this cell.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", metavar="N", min=0, help="Run only this seed of the trainings.")] = None,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", metavar="N", min=1, help="Number of parallel trainings; by default 2, or 1 on a single core."),
    ] = None,
    budget_minutes: Annotated[
        float | None, typer.Option("--budget-minutes", metavar="M", min=0, help="Start nothing new after this many minutes.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder of results and pages; by default results/ and docs/ of the clone.",
        ),
    ] = None,
    work: Annotated[
        Path | None,
        typer.Option("--work", metavar="DIR", help="Folder of checkpoints and farms; by default build/experiments of the clone."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Run the missing parts of an experiment (trainings, trials on its own farm, measurements) and write its page and figure."""
    if name is None and not list_pieces:
        raise UsageProblem(f"say which experiment: {', '.join(NAMES)}; --list shows what is done of each")
    if name is not None and name not in NAMES:
        raise UsageProblem(f"no experiment {name!r}; choose from {', '.join(NAMES)}{meant(name, NAMES)}")
    flags = [flag for flag, given in (("--quick", quick), ("--list", list_pieces), ("--json", as_json)) if given]
    settings = (
        ("--only", only),
        ("--seed", seed),
        ("--jobs", jobs),
        ("--budget-minutes", budget_minutes),
        ("--out", out),
        ("--work", work),
    )
    for flag, value in settings:
        flags += [] if value is None else [flag, str(value)]
    again = (
        "with the --out that it named above, the same command goes on" if quick and out is None else "the same command goes on"
    )
    command = clone_command(EXPERIMENTS, *([] if name is None else [name]), *flags)
    code = run_to_end(command, f"'experiment' has been stopped; {again}", ends_within_s=ENDS_WITHIN_S)
    if code not in ENDS:
        raise ClientError(f"'experiment' {how_it_ended(code)}")
    raise typer.Exit(code)
