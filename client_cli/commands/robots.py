"""``trifarm robots``: what every robot does, and drain, resume or forget one."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import typer

from api_schemas.robot import Robot, RobotState
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import load_connection
from client_cli.terminal.errors import Refused
from client_cli.terminal.exit_codes import OF_EVERY_REQUEST, epilog
from client_cli.terminal.options import JsonOption
from client_cli.terminal.output import age, print_document, print_line, print_table
from client_cli.terminal.wrong_values import meant

COLUMNS = ("robot", "state", "pid", "host", "trial", "simulated", "done", "seen", "reason")
RobotArgument = Annotated[str, typer.Argument(metavar="ROBOT", help="Robot name, such as robot-2.")]

commands = typer.Typer(invoke_without_command=True)


@commands.callback(epilog=epilog(*OF_EVERY_REQUEST))
def robots(context: typer.Context, as_json: JsonOption = False) -> None:
    """List the robots with state, process and trial, and the reason if one is out of service."""
    if context.invoked_subcommand:
        return
    with ApiClient(load_connection(os.environ)) as client:
        found = client.robots()
    if as_json:
        print_document({"robots": [robot.model_dump(mode="json") for robot in found]})
    else:
        print_table(COLUMNS, (_row(robot) for robot in found))


@commands.command(epilog=epilog(*OF_EVERY_REQUEST))
def drain(robot: RobotArgument, as_json: JsonOption = False) -> None:
    """Drain a robot: it finishes its trial and gets no other."""
    with ApiClient(load_connection(os.environ)) as client, robot_meant(client, robot):
        answered = client.drain(robot)
    _show(answered, f"{robot} is {_now(answered)}", as_json)


@commands.command(epilog=epilog(*OF_EVERY_REQUEST))
def resume(robot: RobotArgument, as_json: JsonOption = False) -> None:
    """Give a robot trials again; a robot out of service repeats its self-test first."""
    with ApiClient(load_connection(os.environ)) as client, robot_meant(client, robot):
        answered = client.resume(robot)
    # The farm answers before the robot has heard of it.
    will = {
        RobotState.DRAINING: "will take trials again",
        RobotState.OUT_OF_SERVICE: f"is to test itself again; until then it is {_now(answered)}",
    }
    _show(answered, f"{robot} {will.get(answered.state, f'is {_now(answered)}')}", as_json)


@commands.command(epilog=epilog(*OF_EVERY_REQUEST))
def forget(robot: RobotArgument, as_json: JsonOption = False) -> None:
    """Remove a lost robot from the list; its trials stay."""
    with ApiClient(load_connection(os.environ)) as client, robot_meant(client, robot):
        client.forget(robot)
    if as_json:
        print_document({"robot": robot, "forgotten": True})
    else:
        print_line(f"{robot} is forgotten")


@contextmanager
def robot_meant(client: ApiClient, name: str) -> Iterator[None]:
    """A robot that the farm does not know is refused with the name that may have been meant."""
    try:
        yield
    except Refused as error:
        if not error.problem.type.endswith("robot-not-found"):
            raise
        said = error.problem.detail.rstrip(".") + meant(name, [each.robot for each in client.robots()])
        raise Refused(error.problem.model_copy(update={"detail": said})) from error


def _now(robot: Robot) -> str:
    return f"{robot.state.value}{f': {robot.reason}' if robot.reason else ''}"


def _show(robot: Robot, sentence: str, as_json: bool) -> None:
    if as_json:
        print_document(robot)
    else:
        print_line(sentence)


def _row(robot: Robot) -> tuple[object, ...]:
    simulated = None if robot.simulated_s is None else f"{robot.simulated_s:.1f} s"
    seen = age(robot.last_seen_at)
    return (
        robot.robot, robot.state, robot.pid, robot.host, robot.trial, simulated, robot.trials_done, seen, robot.reason or ""
    )  # fmt: skip
