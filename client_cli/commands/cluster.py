"""``trifarm cluster``: the Ray cluster that trainings may be spread over."""

from typing import Annotated

import typer

from client_cli.embedded.child_process import module_command
from client_cli.terminal.errors import ClientError
from client_cli.terminal.exit_codes import ExitCode, epilog
from client_cli.terminal.foreground import how_it_ended, run_to_end
from client_cli.terminal.options import JsonOption

WORKERS = "sim_backend.workers"
ENDS = (ExitCode.OK, ExitCode.OTHER, ExitCode.USAGE)

commands = typer.Typer(no_args_is_help=True)


@commands.callback()
def cluster() -> None:
    """Look at the Ray cluster that trainings may be spread over."""


@commands.command("status", epilog=epilog(*ENDS))
def status(
    address: Annotated[str, typer.Option("--cluster", metavar="HOST:PORT", help="Address of the Ray.")] = "127.0.0.1:6379",
    *,
    as_json: JsonOption = False,
) -> None:
    """Show the nodes and cores of a Ray cluster."""
    command = module_command(WORKERS, address, *(["--json"] if as_json else []))
    code = run_to_end(command, "'cluster status' has been stopped")
    if code not in ENDS:
        raise ClientError(f"'cluster status' {how_it_ended(code)}")
    raise typer.Exit(code)
