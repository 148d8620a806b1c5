"""A part of this installation that runs in a process of its own, so that the client loads no simulator, and answers on stdout."""

import subprocess
from typing import NoReturn

import typer

from client_cli.embedded.child_process import child_environment
from client_cli.terminal.errors import ClientError
from client_cli.terminal.foreground import how_it_ended
from client_cli.terminal.output import print_line


def answer_of(command: list[str], stderr: int | None = None) -> subprocess.CompletedProcess[str]:
    """What a child printed, and its exit code.

    It gets a session of its own, so that a Ctrl-C reaches only us, and ends with us.

    Args:
        command: what to run.
        stderr: where its stderr goes, as for ``subprocess.run``; to ours if None.
    """
    return subprocess.run(
        command,
        env=child_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
        check=False,
        start_new_session=True,
    )


def pass_on(name: str, ended: subprocess.CompletedProcess[str]) -> NoReturn:
    """Print what a child printed and end as it did.

    Args:
        name: of the command that it stands for.
        ended: the child.

    Raises:
        Exit: with its code.
        ClientError: a signal ended it.
    """
    if ended.stdout:
        print_line(ended.stdout.removesuffix("\n"))
    if ended.returncode < 0:
        raise ClientError(f"'{name}' {how_it_ended(ended.returncode)}", after_document=bool(ended.stdout))
    raise typer.Exit(ended.returncode)
