"""``trifarm gap``: what measured data say is wrong with a model, how good that answer is, and what to record next."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from client_cli.embedded.child_process import module_command
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.exit_codes import ExitCode, epilog
from client_cli.terminal.foreground import how_it_ended, run_to_end
from client_cli.terminal.options import JsonOption

REALITY_GAP = "sim_backend.reality_gap"
ENDS = (ExitCode.OK, ExitCode.OTHER, ExitCode.USAGE, ExitCode.INTERRUPTED)

commands = typer.Typer(no_args_is_help=True)


@commands.callback(epilog=epilog(*ENDS))
def gap() -> None:
    """Compare measured data with a model and name the cause of the difference."""


class Method(StrEnum):
    """Ways from data to a better model."""

    NAMING = "naming"
    ROLLOUTS = "rollouts"
    TORQUES = "torques"
    SIMOPT = "simopt"
    COORDINATE_DESCENT = "coordinate-descent"


@commands.command(epilog=epilog(*ENDS))
def study(
    data: Annotated[Path, typer.Argument(metavar="STUDY.toml|LOGDIR", help="A study.toml, or a folder of a robot's logs.")],
    *,
    data_folder: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the data files; overrides the one in study.toml.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for the results; by default gap-NAME.")] = None,
    method: Annotated[
        Method,
        typer.Option(
            "--method",
            help="naming asks torques and, of a study.toml, simulated motions; rollouts and torques ask one alone; "
            "the others only calibrate.",
        ),
    ] = Method.NAMING,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of the study; by default 0.")] = None,
    trials: Annotated[
        Path | None,
        typer.Option("--trials", metavar="JOBDIR", help="Fetched trials of a policy on the same robot, to predict its success."),
    ] = None,
    policy: Annotated[
        Path | None, typer.Option("--policy", metavar="FILE", help="Weights of that policy; with --trials.")
    ] = None,
    manifest: Annotated[
        str | None,
        typer.Option("--manifest", metavar="LAYOUT|FILE", help="Manifest of that policy, as a layout or a file; with --trials."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find where measured data and a model disagree, name the cause, write an extended model and measure its gain."""
    if not data.exists():
        raise UsageProblem(
            f"there is no file or folder {data}; give a study.toml, or a folder of logs as 'trifarm fetch' makes it"
        )
    if data_folder is not None and not data_folder.is_dir():
        raise UsageProblem(f"there is no folder {data_folder}")
    success = (("--trials", trials), ("--policy", policy), ("--manifest", manifest))
    if len([value for _, value in success if value is not None]) not in (0, len(success)):
        raise UsageProblem("--trials, --policy and --manifest go together")
    flags = [*_given("--data", data_folder), *_given("--out", out), "--method", method.value, *_given("--seed", seed)]
    flags += [text for flag, value in success for text in _given(flag, value)]
    _run("study", str(data), *flags, as_json=as_json)


@commands.command(epilog=epilog(*ENDS))
def replay(
    extended: Annotated[Path, typer.Argument(metavar="DIR|MJCF", help="Folder that 'trifarm gap study' wrote, or a model.")],
    recordings: Annotated[Path, typer.Argument(metavar="STUDY.toml", help="Recordings, best ones that no study has seen.")],
    *,
    data_folder: Annotated[
        Path | None, typer.Option("--data", metavar="DIR", help="Folder of the data files; overrides the one in study.toml.")
    ] = None,
    model: Annotated[
        list[Path] | None, typer.Option("--model", metavar="MJCF", help="Another model to replay, too; several times.")
    ] = None,
    window: Annotated[
        float | None,
        typer.Option("--window", metavar="SECONDS", help="Begin anew where the robot was; by default only once a recording."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Replay recordings with an extended model, in the loop in which they were made: how far does it go from the robot?"""
    for path in (extended, recordings, *(model or ())):
        if not path.exists():
            raise UsageProblem(f"there is no file or folder {path}")
    flags = [*_given("--data", data_folder), *_given("--window", window)]
    flags += [text for path in model or () for text in _given("--model", path)]
    _run("replay", str(extended), str(recordings), *flags, as_json=as_json)


@commands.command(epilog=epilog(*ENDS))
def blind_test(
    *,
    cases: Annotated[
        int | None,
        typer.Option(
            "--cases",
            metavar="N",
            min=0,
            help="Number of robots with a hidden effect, 30 by default; N/2 healthy robots are added.",
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of the hidden effects; by default 1.")] = None,
    excitation: Annotated[
        str | None,
        typer.Option(
            "--excitation", metavar="NAME", help="Excitation of the robots, as for identify, or everything; by default standard."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder of the results; by default blind-test.")
    ] = None,
    processes: Annotated[
        int | None, typer.Option("--processes", metavar="N", min=1, help="Number of parallel processes; by default 2.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option("--cluster", metavar="ADDRESS", help="Ray that has the processes: 'local' or HOST:PORT.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Hide effects in simulated robots and count how often a study names them; a stopped test continues."""
    flags = [*_given("--cases", cases), *_given("--seed", seed), *_given("--excitation", excitation)]
    flags += [*_given("--out", out), *_given("--processes", processes), *_given("--cluster", cluster)]
    _run("blind-test", *flags, as_json=as_json)


@commands.command(epilog=epilog(*ENDS))
def excite(
    earlier: Annotated[
        Path | None, typer.Argument(metavar="STUDY_OR_REPORT", help="A study's study.json, report.html or folder.")
    ] = None,
    *,
    robot: Annotated[
        str | None, typer.Option("--robot", metavar="ROBOT", help="Robot of the farm, for the suggested command.")
    ] = None,
    excitation: Annotated[
        str | None,
        typer.Option("--excitation", metavar="NAME", help="Excitation that --csv writes; by default the first suggested one."),
    ] = None,
    csv: Annotated[
        Path | None,
        typer.Option("--csv", metavar="FILE", help="Write an excitation's position targets to a table, for a robot elsewhere."),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option("--model", metavar="MJCF", help="Model with the joints and ranges for --csv; by default the study's."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="Seed of the excitation that --csv writes; by default 0.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Suggest the next recording: to settle a study's verdict or, without a study, to separate most causes."""
    for path in (earlier, model):
        if path is not None and not path.exists():
            raise UsageProblem(f"there is no file {path}")
    if earlier is not None and earlier.is_dir() and not (earlier / "study.json").is_file():
        raise UsageProblem(f"{earlier} holds no study.json; give the folder that 'trifarm gap study' wrote, or no study at all")
    if csv is not None and not csv.absolute().parent.is_dir():
        raise UsageProblem(f"cannot write {csv}: there is no folder {csv.absolute().parent}")
    flags = [*_given("--robot", robot), *_given("--excitation", excitation), *_given("--csv", csv), *_given("--model", model)]
    _run("excite", *([] if earlier is None else [str(earlier)]), *flags, *_given("--seed", seed), as_json=as_json)


def _given(flag: str, value: object) -> list[str]:
    """A flag and its value; nothing if there is none, so that each default has one home, in the child."""
    return [] if value is None else [flag, str(value)]


def _run(*arguments: str, as_json: bool) -> None:
    """Run a part of the reality gap in a process of its own, which prints for itself, and end with its exit code."""
    goes_on = "; the same command goes on where it stopped" if arguments[0] == "blind-test" else ""
    command = module_command(REALITY_GAP, *arguments, *(["--json"] if as_json else []))
    code = run_to_end(command, f"'gap {arguments[0]}' has been stopped{goes_on}")
    if code not in ENDS:
        raise ClientError(f"'gap {arguments[0]}' {how_it_ended(code)}")
    raise typer.Exit(code)
