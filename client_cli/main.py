"""The table of contents of ``trifarm``: every command with the file it lives in and the codes it exits with."""

import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, NoReturn

import typer

from client_cli.commands import (
    canary,
    chaos,
    check,
    compare,
    demo,
    experiment,
    fetch,
    gap,
    identify,
    jobs,
    ladder,
    pack,
    physics,
    policy,
    replay,
    report,
    robots,
    status,
    submit,
    token,
    top,
    train,
    up,
    upkeep,
    verify,
)
from client_cli.terminal.errors import ClientError, error_document, error_line, files_checked
from client_cli.terminal.exit_codes import MEANING, OF_EVERY_REQUEST, ExitCode, epilog
from client_cli.terminal.output import drop_stdout, note, print_document
from client_cli.terminal.wrong_values import Commands

app = typer.Typer(
    name="trifarm",
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    epilog=epilog(*MEANING),
)

OF_A_CHILD = (ExitCode.OK, ExitCode.OTHER, ExitCode.USAGE)
JOB_END = (*OF_EVERY_REQUEST, ExitCode.JOB_WITHOUT_REPORT, ExitCode.INTERRUPTED)

app.command(epilog=epilog(*OF_A_CHILD))(up.up)
app.command(epilog=epilog(*JOB_END))(demo.demo)
app.command(epilog=epilog(*OF_A_CHILD, ExitCode.REFUSED, ExitCode.INTERRUPTED))(check.check)
app.command(epilog=epilog(*JOB_END))(submit.submit)
app.command(epilog=epilog(*OF_A_CHILD))(pack.pack)
app.command(epilog=epilog(*JOB_END))(identify.identify)
app.command(epilog=epilog(*OF_EVERY_REQUEST))(jobs.jobs)
app.command(epilog=epilog(*OF_EVERY_REQUEST))(ladder.ladder)
app.command(epilog=epilog(*JOB_END))(jobs.watch)
app.command(epilog=epilog(*OF_EVERY_REQUEST))(jobs.cancel)
app.command(epilog=epilog(*OF_EVERY_REQUEST))(report.report)
app.command("compare", epilog=epilog(*OF_EVERY_REQUEST, ExitCode.WORSE))(compare.compare_jobs)
app.command(epilog=epilog(*OF_A_CHILD, ExitCode.DIFFERS, ExitCode.UNVERIFIED, ExitCode.LOGS_MISSING))(verify.verify)
app.command(epilog=epilog(*JOB_END))(fetch.fetch)
app.command(epilog=epilog(*OF_EVERY_REQUEST, ExitCode.DIFFERS))(replay.replay)
app.command(epilog=epilog(*OF_A_CHILD))(physics.effects)
app.command(epilog=epilog(*OF_A_CHILD))(physics.physics)
app.command(epilog=epilog(*OF_A_CHILD, ExitCode.INTERRUPTED))(train.train)
app.add_typer(gap.commands, name="gap")
app.add_typer(robots.commands, name="robots")
app.add_typer(canary.commands, name="canary")
app.add_typer(policy.commands, name="policy")
app.command(epilog=epilog(*OF_EVERY_REQUEST))(status.status)
app.command(epilog=epilog(*OF_EVERY_REQUEST))(top.top)
app.command(epilog=epilog(*OF_A_CHILD))(upkeep.backup)
app.command(epilog=epilog(*OF_A_CHILD))(upkeep.restore)
app.command(epilog=epilog(*OF_A_CHILD))(upkeep.doctor)
app.command(epilog=epilog(*OF_A_CHILD, ExitCode.INTERRUPTED))(chaos.chaos)
app.command(epilog=epilog(*OF_A_CHILD, ExitCode.INTERRUPTED))(experiment.experiment)
app.add_typer(token.commands, name="token")


def _print_version(is_asked: bool) -> None:
    if is_asked:
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
