"""``trifarm token``: who may do what; for the administrator."""

import os
from typing import Annotated

import typer
from pydantic import ValidationError

from api_schemas.token import Scope, Token, TokenRequest
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.exit_codes import OF_EVERY_REQUEST, epilog
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import age, note, print_document, print_line, print_table
from client_cli.terminal.wrong_values import sentence

COLUMNS = ("token", "owner", "scopes", "age", "used", "expires", "revoked")

commands = typer.Typer(no_args_is_help=True)


@commands.callback(epilog=epilog(*OF_EVERY_REQUEST))
def token() -> None:
    """Create, list and revoke access tokens."""


@commands.command(epilog=epilog(*OF_EVERY_REQUEST))
def create(
    owner: Annotated[str, typer.Option("--owner", metavar="NAME", help="Owner of the token and of its jobs.")],
    scope: Annotated[list[Scope], typer.Option("--scope", help="Permission of the token; repeatable.")],
    days: Annotated[
        float | None, typer.Option("--days", min=0.001, help="Days until the token expires; by default it never does.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Create a token and print it once; the server keeps only its hash."""
    try:
        request = TokenRequest(owner=owner, scopes=tuple(scope), expires_in_days=days)
    except ValidationError as error:
        if error.errors()[0]["loc"][:1] == ("owner",):
            raise UsageProblem(f"the owner is {owner!r}; allowed are 1 to 64 letters, digits and . _ @ -") from error
        raise UsageProblem(sentence(error, "the token").replace("expires_in_days", "--days")) from error
    with ApiClient(load_connection(os.environ)) as client:
        token = client.create_token(request)
    if as_json:
        print_document(token)
    else:
        print_line(token.secret)
        note(f"token {token.token_id} of {token.owner}; keep it now, it is not shown again")


@commands.command("list", epilog=epilog(*OF_EVERY_REQUEST))
def list_tokens(as_json: JsonOption = False) -> None:
    """List all tokens without their secrets."""
    with ApiClient(load_connection(os.environ)) as client:
        found = client.tokens()
    if as_json:
        print_document({"tokens": [token.model_dump(mode="json") for token in found]})
    else:
        print_table(COLUMNS, (_row(token) for token in found))


@commands.command(epilog=epilog(*OF_EVERY_REQUEST))
def revoke(
    token_id: Annotated[str, typer.Argument(metavar="TOKEN", help="Token id, as shown by 'trifarm token list'.")],
    as_json: JsonOption = False,
) -> None:
    """Revoke a token; the server refuses further requests with it."""
    with ApiClient(load_connection(os.environ)) as client:
        client.revoke_token(token_id)
    if as_json:
        print_document({"token_id": token_id, "revoked": True})
    else:
        print_line(f"token {token_id} is revoked")


def _row(token: Token) -> tuple[object, ...]:
    scopes = " ".join(token.scopes)
    return (
        token.token_id,
        token.owner,
        scopes,
        age(token.created_at),
        age(token.last_used_at),
        token.expires_at,
        token.revoked_at,
    )
