"""``trifarm canary``: the policy that every robot tries while it is idle, so that one which changed is noticed."""

import os
from pathlib import Path
from typing import Annotated

import typer
from pydantic import ValidationError

from api_schemas.builtin_policies import builtin_digest
from api_schemas.canary import MAX_CANARY_TRIALS, Canary, CanaryRequest
from client_cli.commands.builtins import builtin_named
from client_cli.commands.uploading import note_warnings, upload
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.policies.policy_files import read_policy
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.exit_codes import OF_EVERY_REQUEST, epilog
from client_cli.terminal.options import JsonOption, LayoutOption, ManifestOption, TaskOption
from client_cli.terminal.output import note, print_document, print_line
from client_cli.terminal.wrong_values import sentence

HOUR_S = 3600.0

commands = typer.Typer(invoke_without_command=True)


@commands.callback(epilog=epilog(*OF_EVERY_REQUEST))
def canary(context: typer.Context, as_json: JsonOption = False) -> None:
    """Show the farm's canary policy (operators only)."""
    if context.invoked_subcommand:
        return
    with ApiClient(load_connection(os.environ)) as client:
        _show(client.canary(), as_json)


@commands.command("set", epilog=epilog(*OF_EVERY_REQUEST))
def choose(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Weights of the policy, or builtin:grasp[-turn].")],
    task: TaskOption,
    at_least: Annotated[float, typer.Option("--at-least", min=0, max=1, help="Lowest success rate of a healthy robot.")],
    *,
    trials: Annotated[int, typer.Option("--trials", min=1, max=MAX_CANARY_TRIALS, help="Number of goals for each robot.")] = 10,
    every_h: Annotated[float, typer.Option("--every-h", help="Hours between two checks of a robot.")] = 24.0,
    manifest: ManifestOption = None,
    layout: LayoutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Set a canary policy: idle robots try it regularly, and a robot below --at-least leaves service."""
    builtin = builtin_named(file)
    policy = None if builtin else read_policy(file, manifest, layout)
    digest = builtin_digest(builtin) if policy is None else policy.digest
    asked = {"policy": digest, "task": task, "trials": trials, "at_least": at_least, "every_s": every_h * HOUR_S}
    try:
        wish = CanaryRequest.model_validate(asked)
    except ValidationError as error:
        raise UsageProblem(sentence(error, "the canary")) from error
    with ApiClient(load_connection(os.environ)) as client:
        if policy is None:
            client.take_builtin(builtin)
        else:
            note_warnings(upload(client, policy, wish.task))
        _show(client.set_canary(wish), as_json)


@commands.command(epilog=epilog(*OF_EVERY_REQUEST))
def off(as_json: JsonOption = False) -> None:
    """Remove the canary; robots that failed it stay out of service until they are resumed."""
    with ApiClient(load_connection(os.environ)) as client:
        client.drop_canary()
    if as_json:
        print_document({"dropped": True})
        return
    note("no canary; 'trifarm robots resume ROBOT' takes a robot that left the band into service again")


def _show(shown: Canary, as_json: bool) -> None:
    if as_json:
        print_document(shown)
        return
    tried = f"{shown.trials} trials of {shown.task.value} every {shown.every_s / HOUR_S:g} h on each idle robot"
    print_line(f"{shown.policy_name}: {tried}; out of service below {100 * shown.at_least:g} % (set by {shown.set_by})")
