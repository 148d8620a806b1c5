"""The table of contents of ``trifarm``: every command with the file it lives in and the codes it exits with.

A module is imported when its command is asked for, so that the rest costs nothing.
"""

import sys
from typing import Annotated, NoReturn

import typer

from client_cli.contents import Row, contents
from client_cli.errors import ClientError, error_document, error_line, files_checked
from client_cli.exit_codes import MEANING, OF_EVERY_REQUEST, ExitCode, epilog
from client_cli.output import drop_stdout, note, print_document

OF_A_CHILD = (ExitCode.OK, ExitCode.OTHER, ExitCode.USAGE)
OF_A_LONG_CHILD = (*OF_A_CHILD, ExitCode.INTERRUPTED)
JOB_END = (*OF_EVERY_REQUEST, ExitCode.JOB_WITHOUT_REPORT, ExitCode.INTERRUPTED)
OF_ITS_OWN = ()
"""The commands of a group name the codes that they end with."""

# fmt: off
COMMANDS = (
    Row("up", "client_cli.up:up", OF_A_CHILD,
        "Start a farm with API, dispatcher and robots, and keep it running until Ctrl-C."),
    Row("demo", "client_cli.demo:demo", JOB_END,
        "Start a farm, run a policy on it, print the report, fetch the logs and stop the farm."),
    Row("check", "client_cli.check:check", (*OF_A_CHILD, ExitCode.REFUSED, ExitCode.INTERRUPTED),
        "Say whether the server would accept a policy, with its own checks run here; nothing is sent."),
    Row("submit", "client_cli.submit:submit", JOB_END,
        "Upload a policy, queue a job of trials and print the job's id; of a folder, one job for each checkpoint."),
    Row("pack", "client_cli.pack:pack", OF_A_CHILD,
        "Pack a checkpoint into weights and manifest, compared with the original on 1,000 observations."),
    Row("identify", "client_cli.identify:identify", JOB_END,
        "Queue excitations on one robot and print the job's id; each is a trial with a log of its own."),
    Row("jobs", "client_cli.jobs:jobs", OF_EVERY_REQUEST,
        "List your jobs, newest first."),
    Row("ladder", "client_cli.ladder:ladder", OF_EVERY_REQUEST,
        "Show a ladder: how each checkpoint of a folder does on the same goals, as far as it is."),
    Row("watch", "client_cli.watch:watch", JOB_END,
        "Follow a job with a live bar until it ends; Ctrl-C leaves the job running."),
    Row("cancel", "client_cli.cancel:cancel", OF_EVERY_REQUEST,
        "Cancel a job: queued trials never start, running ones are stopped. Cancelling twice does no harm."),
    Row("report", "client_cli.report:report", OF_EVERY_REQUEST,
        "Print a job's report: success rate with intervals, robots, trials, and whose fault each failure was."),
    Row("compare", "client_cli.compare:compare_jobs", (*OF_EVERY_REQUEST, ExitCode.WORSE),
        "Compare jobs goal by goal: paired difference with interval and exact p, and which trials changed sides."),
    Row("verify", "client_cli.verify:verify", (*OF_A_CHILD, ExitCode.DIFFERS, ExitCode.UNVERIFIED, ExitCode.LOGS_MISSING),
        "Check a signed report without a connection: is it what its farm signed, and who was that?"),
    Row("fetch", "client_cli.fetch:fetch", JOB_END,
        "Download a job's logs (trial-000.mcap …) and, last of all, report.json. Run again, it brings only what is missing."),
    Row("replay", "client_cli.replay:replay", (*OF_EVERY_REQUEST, ExitCode.DIFFERS),
        "Show what a log holds; with --verify simulate it again, here or on the server if only that knows the robot's physics."),
    Row("effects", "client_cli.effects:effects", OF_A_CHILD,
        "List every effect a robot may have, with the bounds, units and sources of its parameters."),
    Row("physics", "client_cli.physics:physics", OF_A_CHILD,
        "Print a robot's hidden physics. Nothing of it is ever shown by the server."),
    Row("train", "client_cli.train:train", OF_A_LONG_CHILD,
        "Train a policy by a recipe in many simulations at once; ends with a file that can be submitted."),
    Row("status", "client_cli.status:status", OF_EVERY_REQUEST,
        "Say how the farm is: robots, queue, and what is wrong if something is."),
    Row("top", "client_cli.top:top", OF_EVERY_REQUEST,
        "Watch the farm in the terminal: problems, robots, jobs that run and wait. Ctrl-C ends it."),
    Row("backup", "client_cli.backup:backup", OF_A_CHILD,
        "Copy a farm's database, policies, logs and tokens to a folder; the farm may run meanwhile."),
    Row("restore", "client_cli.restore:restore", OF_A_CHILD,
        "Make the farm that a backup holds, in an empty folder; every file is checked on the way."),
    Row("doctor", "client_cli.doctor:doctor", OF_A_CHILD,
        "Look through a farm's database, files, reports and disk; the farm may run meanwhile."),
    Row("chaos", "client_cli.chaos:chaos", OF_A_LONG_CHILD,
        "Start a farm, break it in every way we know while clients work, and check that it kept its promises."),
    Row("experiment", "client_cli.experiment:experiment", OF_A_LONG_CHILD,
        "Run what is missing of an experiment: trainings, trials on a farm of its own, measurements; "
        "write figure, page and JSON."),
    Row("gap", "client_cli.gap:commands", OF_ITS_OWN,
        "Compare measured data with a model and name the cause."),
    Row("robots", "client_cli.robots:commands", OF_ITS_OWN,
        "List the robots: state, process, trial and, if a robot is not in service, why."),
    Row("canary", "client_cli.canary:commands", OF_ITS_OWN,
        "Show the farm's canary; for operators."),
    Row("policy", "client_cli.policy:commands", OF_ITS_OWN,
        "Delete policies that are not needed any more."),
    Row("token", "client_cli.token:commands", OF_ITS_OWN,
        "Make, list and revoke access tokens."),
)
# fmt: on

app = typer.Typer(
    name="trifarm",
    cls=contents(COMMANDS),
    no_args_is_help=True,
    add_completion=False,
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
