"""The table of contents of ``trifarm``: every command with the file it lives in and the codes it exits with.

A command is imported when it runs, so that ``trifarm --help`` costs no more than its own text.
"""

import sys
from typing import Annotated, NoReturn

import typer

from client_cli.terminal.commands import Entry, LazyCommands
from client_cli.terminal.errors import ClientError, error_document, error_line, files_checked
from client_cli.terminal.exit_codes import MEANING, OF_EVERY_REQUEST, ExitCode, epilog
from client_cli.terminal.output import drop_stdout, note, print_document

OF_A_CHILD = (ExitCode.OK, ExitCode.OTHER, ExitCode.USAGE)
JOB_END = (*OF_EVERY_REQUEST, ExitCode.JOB_WITHOUT_REPORT, ExitCode.INTERRUPTED)

GROUPS = {
    "Jobs and policies": {
        "demo": Entry("client_cli.commands.demo:demo", JOB_END),
        "check": Entry("client_cli.commands.check:check", (*OF_A_CHILD, ExitCode.REFUSED, ExitCode.INTERRUPTED)),
        "layouts": Entry("client_cli.commands.layouts:layouts", OF_A_CHILD),
        "submit": Entry("client_cli.commands.submit:submit", JOB_END),
        "jobs": Entry("client_cli.commands.jobs:jobs", OF_EVERY_REQUEST),
        "watch": Entry("client_cli.commands.jobs:watch", JOB_END),
        "label": Entry("client_cli.commands.label:label", OF_EVERY_REQUEST),
        "cancel": Entry("client_cli.commands.jobs:cancel", OF_EVERY_REQUEST),
        "report": Entry("client_cli.commands.report:report", OF_EVERY_REQUEST),
        "compare": Entry("client_cli.commands.compare:compare_jobs", (*OF_EVERY_REQUEST, ExitCode.WORSE)),
        "ladder": Entry("client_cli.commands.ladder:ladder", OF_EVERY_REQUEST),
        "why": Entry("client_cli.commands.why:why", (*OF_EVERY_REQUEST, ExitCode.DIFFERS, ExitCode.OTHER_FORM)),
        "leaderboard": Entry("client_cli.commands.leaderboard:leaderboard", OF_EVERY_REQUEST),
        "fetch": Entry("client_cli.commands.fetch:fetch", JOB_END),
        "share": Entry("client_cli.commands.share:commands"),
        "look": Entry("client_cli.commands.pictures:look", OF_A_CHILD),
        "video": Entry("client_cli.commands.pictures:video", OF_A_CHILD),
        "policy": Entry("client_cli.commands.policy:commands"),
    },
    "Running a farm": {
        "up": Entry("client_cli.commands.up:up", OF_A_CHILD),
        "status": Entry("client_cli.commands.status:status", OF_EVERY_REQUEST),
        "top": Entry("client_cli.commands.top:top", OF_EVERY_REQUEST),
        "robots": Entry("client_cli.commands.robots:commands"),
        "canary": Entry("client_cli.commands.canary:commands"),
        "token": Entry("client_cli.commands.token:commands"),
        "backup": Entry("client_cli.commands.upkeep:backup", OF_A_CHILD),
        "restore": Entry("client_cli.commands.upkeep:restore", OF_A_CHILD),
        "doctor": Entry("client_cli.commands.upkeep:doctor", OF_A_CHILD),
    },
    "The reality gap": {
        "identify": Entry("client_cli.commands.identify:identify", JOB_END),
        "gap": Entry("client_cli.commands.gap:commands"),
        "effects": Entry("client_cli.commands.physics:effects", OF_A_CHILD),
        "calibrate-tracker": Entry(
            "client_cli.commands.calibrate_tracker:calibrate_tracker", (*OF_A_CHILD, ExitCode.INTERRUPTED)
        ),
        "physics": Entry("client_cli.commands.physics:physics", OF_A_CHILD),
    },
    "Learning": {
        "train": Entry("client_cli.commands.train:train", (*OF_A_CHILD, ExitCode.INTERRUPTED)),
        "cluster": Entry("client_cli.commands.cluster:commands"),
        "pack": Entry("client_cli.commands.pack:pack", OF_A_CHILD),
        "experiment": Entry("client_cli.commands.experiment:experiment", (*OF_A_CHILD, ExitCode.INTERRUPTED)),
    },
    "Checks and chaos": {
        "verify": Entry(
            "client_cli.commands.verify:verify", (*OF_A_CHILD, ExitCode.DIFFERS, ExitCode.UNVERIFIED, ExitCode.LOGS_MISSING)
        ),
        "replay": Entry("client_cli.commands.replay:replay", (*OF_EVERY_REQUEST, ExitCode.DIFFERS, ExitCode.OTHER_FORM)),
        "chaos": Entry("client_cli.commands.chaos:chaos", (*OF_A_CHILD, ExitCode.INTERRUPTED)),
    },
}
"""Every command, in the groups of the help and of ``docs/cli``."""


class Trifarm(LazyCommands):
    """The commands of ``trifarm``."""

    groups = GROUPS


app = typer.Typer(
    name="trifarm",
    cls=Trifarm,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    epilog=epilog(*MEANING),
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        from importlib.metadata import PackageNotFoundError, version

        try:
            typer.echo(version("trifarm"))
        except PackageNotFoundError:
            typer.echo("unknown: run from a folder that is not installed")
        raise typer.Exit


@app.callback()
def trifarm(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """Upload a trained policy to a farm of simulated TriFinger robots; get logs and a success rate."""


def run(arguments: list[str] | None = None) -> NoReturn:
    """Run the command line and end the process with the documented exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        with files_checked():
            app(given, prog_name="trifarm")
    except ClientError as error:
        _tell(error, as_json="--json" in given and not error.after_document)
        sys.exit(int(error.exit_code))
    except BrokenPipeError:
        drop_stdout()
        sys.exit(ExitCode.OTHER)
    sys.exit(ExitCode.OK)


def _tell(error: ClientError, *, as_json: bool) -> None:
    """Why a command failed, on stderr even if it is stdout that takes nothing more."""
    try:
        if as_json:
            print_document(error_document(error))
        sys.stdout.flush()
    except OSError:
        drop_stdout()
    note(error_line(error))
