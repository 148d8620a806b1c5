"""``trifarm policy``: what is done with policies that are on the farm."""

import os
from typing import Annotated

import typer

from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.exit_codes import OF_EVERY_REQUEST, epilog
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import print_document, print_line

DIGEST_DIGITS = 64

commands = typer.Typer(no_args_is_help=True)


@commands.callback()
def policy() -> None:
    """Delete policies from the farm."""


@commands.command(epilog=epilog(*OF_EVERY_REQUEST))
def delete(
    digest: Annotated[str, typer.Argument(metavar="DIGEST", help="Policy digest, as shown by 'trifarm jobs --json'.")],
    as_json: JsonOption = False,
) -> None:
    """Delete one of your policies that no job uses."""
    if len(digest) != DIGEST_DIGITS or set(digest) - set("0123456789abcdef"):
        raise UsageProblem(f"{digest!r} is no digest of a policy, which is {DIGEST_DIGITS} hexadecimal digits")
    with ApiClient(load_connection(os.environ)) as client:
        client.delete_policy(digest)
    if as_json:
        print_document({"digest": digest, "deleted": True})
    else:
        print_line(f"policy {digest} is deleted")
