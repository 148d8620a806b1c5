"""``trifarm share``: links to one report or one trial for whoever has no token."""

import os
from typing import Annotated

import typer
from pydantic import ValidationError

from api_schemas.share import LATEST_S, MOST_DAYS, USUAL_DAYS, Share, ShareRequest
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.exit_codes import OF_EVERY_REQUEST, epilog
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import age, note, print_document, print_line, print_table
from client_cli.terminal.wrong_values import sentence

COLUMNS = ("share", "state", "shows", "owner", "age", "ends")

commands = typer.Typer(no_args_is_help=True)


@commands.callback(epilog=epilog(*OF_EVERY_REQUEST))
def share() -> None:
    """Share a report or a trial by a link that needs no token."""


@commands.command(epilog=epilog(*OF_EVERY_REQUEST))
def create(
    what: Annotated[str, typer.Argument(metavar="JOB|TRIAL", help="Job whose report is shared, or trial that is replayed.")],
    at: Annotated[
        float | None, typer.Option("--at", metavar="SECONDS", min=0, max=LATEST_S, help="Moment at which a trial's replay opens.")
    ] = None,
    days: Annotated[
        float, typer.Option("--days", min=0.001, max=MOST_DAYS, help="Days until the link ends by itself.")
    ] = USUAL_DAYS,
    as_json: JsonOption = False,
) -> None:
    """Share the report of a job, or a trial, and print the link once; the farm keeps only its hash."""
    request = wish_to_share(what, at_s=at, days=days)
    with ApiClient(load_connection(os.environ)) as client:
        made = client.share(request)
    if as_json:
        print_document(made)
    else:
        print_line(made.url)
        note(f"open until {made.expires_at}, not shown again; 'trifarm share revoke {made.share_id}' ends it")


@commands.command("list", epilog=epilog(*OF_EVERY_REQUEST))
def list_shares(as_json: JsonOption = False) -> None:
    """List shares of your own and of your jobs, newest first, without their links."""
    with ApiClient(load_connection(os.environ)) as client:
        found = client.shares()
    if as_json:
        print_document({"shares": [each.model_dump(mode="json") for each in found]})
    else:
        print_table(COLUMNS, (_row(each) for each in found))


@commands.command(epilog=epilog(*OF_EVERY_REQUEST))
def revoke(
    share_id: Annotated[str, typer.Argument(metavar="SHARE", help="Share id, as shown by 'trifarm share list'.")],
    as_json: JsonOption = False,
) -> None:
    """End a share; its link leads nowhere from then on."""
    with ApiClient(load_connection(os.environ)) as client:
        client.revoke_share(share_id)
    if as_json:
        print_document({"share_id": share_id, "revoked": True})
    else:
        print_line(f"share {share_id} is revoked")


def wish_to_share(what: str, *, at_s: float | None, days: float) -> ShareRequest:
    """What is sent to share the report of a job or the replay of a trial, ``what`` being the id of one or the other.

    Raises:
        UsageProblem: it is neither, a moment was named of a report, or a number is out of its bounds.
    """
    kind = "trial" if "-" in what else "job"
    if at_s is not None and kind == "job":
        raise UsageProblem("a moment is one of a trial; a report has none")
    try:
        return ShareRequest.model_validate({kind: what, "at_s": at_s, "days": days})
    except ValidationError as error:
        if error.errors()[0]["loc"] != (kind,):
            raise UsageProblem(sentence(error, "the link")) from error
        examples = "a job reads like jabcdefghijkl, a trial like jabcdefghijkl-007"
        raise UsageProblem(f"{what[:80]!r} is neither a job nor a trial; {examples}") from error


def _row(each: Share) -> tuple[object, ...]:
    state = "open" if each.is_open else "revoked" if each.revoked_at else "over"
    moment = "" if each.at_s is None else f" at {each.at_s:.1f} s"
    shown = f"report of {each.job_id}" if each.trial_id is None else f"trial {each.trial_id}{moment}"
    return (each.share_id, state, shown, each.owner, age(each.created_at), each.expires_at)
