"""A whole farm on this machine: supervises the services and the robots from start to end, and restarts nothing itself."""

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from api_schemas.environment import unknown_settings
from api_schemas.robot import RobotState
from client_cli.connection.api_client import ApiClient
from client_cli.connection.settings import Connection, save_connection
from client_cli.embedded.child_process import ChildProcess, child_environment, module_command, start_child
from client_cli.embedded.claims import held_folder, usable_port
from client_cli.embedded.private_bus import private_bus
from client_cli.embedded.record import FarmRecord, keep_physics, save_record
from client_cli.embedded.robot_options import RobotOptions
from client_cli.embedded.services_settings import given_settings, ignored_settings
from client_cli.terminal.errors import ClientError, Refused
from client_cli.terminal.output import counted, note
from jail.level import JailLevel

HOST = "127.0.0.1"
FARM = "farm"
START_DEADLINE_S = 240.0
"""Of these the first robots of a machine compile for ten seconds, several times that where it is busy."""
ROBOTS_END_WITHIN_S = 2.0
ALL_END_WITHIN_S = 3.5
"""Whoever has not ended by then is killed, so that everything is gone within 5 s."""
ALL_GONE_WITHIN_S = 4.2
POLL_EVERY_S = 0.1
ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@dataclass(frozen=True)
class FarmOptions:
    """What a farm is to be; ``port`` 0 takes any free one, ``home`` gets the settings file; ``jail_level`` None is usual."""

    data: Path
    home: Path
    port: int
    robots: RobotOptions
    jail_level: JailLevel | None = None

    def jail_flags(self) -> list[str]:
        """What services and robots are told of it."""
        return [] if self.jail_level is None else ["--jail-level", self.jail_level.value]


@dataclass(frozen=True)
class EmbeddedFarm:
    """A farm that is ready."""

    connection: Connection
    bus: str
    data: Path
    robots: int
    physics: str
    settings: Path
    children: tuple[ChildProcess, ...]

    def check(self) -> None:
        """Raise an error if a child has ended; logs that have grown large are begun anew."""
        _check(self.children)
        for child in self.children:
            child.rotate()


@contextmanager
def embedded_farm(options: FarmOptions) -> Iterator[EmbeddedFarm]:
    """Start a farm, give it when it is ready, and end it. SIGTERM and SIGHUP then act like Ctrl-C, until it has ended."""
    children: list[ChildProcess] = []
    options.data.mkdir(parents=True, exist_ok=True)
    with held_folder(options.data), _signals_as_interrupt(), private_bus(options.data) as bus:
        try:
            yield _start(options, bus, children)
        finally:
            _end(children)


def _start(options: FarmOptions, bus: str, children: list[ChildProcess]) -> EmbeddedFarm:
    deadline_s = time.monotonic() + START_DEADLINE_S
    port = usable_port(HOST, options.port)
    url = f"http://{HOST}:{port}"
    children.append(_start_services(options, port, bus))
    with ApiClient(Connection(url, None)) as client:
        while not client.is_up():
            _pause(children, deadline_s, f"the services did not answer at {url}")
    tokens = _tokens(options.data)
    robots = replace(options.robots, physics=keep_physics(options.robots.physics, options.data))
    save_record(FarmRecord(robots.physics, robots.farm_seed), options.data)
    children.append(_start_robots(replace(options, robots=robots), url, bus, tokens["robot"]))
    connection = Connection(url, tokens["admin"])
    with ApiClient(connection) as client:
        while (ready := _robots_in_service(client)) < options.robots.count:
            _pause(children, deadline_s, f"only {ready} of {counted(options.robots.count, 'robot')} came up")
        _forget_places(client, options.robots.count)
    settings = save_connection(connection, options.home)
    shown = options.robots.physics_name
    return EmbeddedFarm(connection, bus, options.data, options.robots.count, shown, settings, tuple(children))


def _start_services(options: FarmOptions, port: int, bus: str) -> ChildProcess:
    flags = ["--data", str(options.data), "--host", HOST, "--port", str(port), "--bus", bus, *options.jail_flags()]
    command = module_command("services", "serve", *flags, "--farm", FARM, "--physics", options.robots.physics_name)
    if ignored := ignored_settings(os.environ):
        note(f"not used here, where flags and the data folder decide: {', '.join(ignored)}")
    for said in unknown_settings(os.environ).values():
        note(f"warning: {said}")
    return start_child(
        "services", command, child_environment(**given_settings(os.environ)), options.data / "logs" / "services.log"
    )


def _start_robots(options: FarmOptions, url: str, bus: str, token: str) -> ChildProcess:
    flags = ["--api", url, "--bus", bus, "--farm", FARM, "--data", str(options.data)]
    command = module_command("robot_farm", *flags, *options.robots.flags(), *options.jail_flags())
    environment = child_environment(TRIFARM_ROBOT_TOKEN=token, **options.robots.variables())
    return start_child("robots", command, environment, options.data / "logs" / "robots.log")


def _pause(children: list[ChildProcess], deadline_s: float, late: str) -> None:
    _check(tuple(children))
    if time.monotonic() > deadline_s:
        raise ClientError(
            f"{late} within {START_DEADLINE_S:.0f} s (on a busy machine try again: what was "
            f"compiled is kept); the end of {children[-1].log}:\n{children[-1].tail()}"
        )
    time.sleep(POLL_EVERY_S)


def _check(children: tuple[ChildProcess, ...]) -> None:
    for child in children:
        if child.has_ended():
            code = child.process.returncode
            raise ClientError(f"the {child.name} ended with code {code}; the end of {child.log}:\n{child.tail()}")


def _robots_in_service(client: ApiClient) -> int:
    return sum(robot.state is not RobotState.LOST for robot in client.robots())


def _forget_places(client: ApiClient, count: int) -> None:
    """A folder that had more robots the last time has no lost ones now."""
    places = {f"robot-{number}" for number in range(count)}
    for robot in client.robots():
        if robot.state is RobotState.LOST and robot.robot not in places:
            with suppress(Refused):  # it holds a lease from the last time, or is coming at this moment
                client.forget(robot.robot)


def _tokens(data: Path) -> dict[str, str]:
    path = data / "tokens.json"
    try:
        tokens = json.loads(path.read_text())
        return {"admin": tokens["admin"], "robot": tokens["robot"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ClientError(f"cannot read the farm's tokens from {path} ({error}); use another --data folder") from error


@contextmanager
def _signals_as_interrupt() -> Iterator[None]:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    # A shell's background job starts with SIGINT ignored, and is to end by it all the same; nohup's wish is kept.
    numbers = [number for number in ENDING_SIGNALS if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, interrupt) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(children: list[ChildProcess]) -> None:
    """End robots before services; a second Ctrl-C changes nothing, since this takes at most 5 s anyhow."""
    for number in ENDING_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    start_s = time.monotonic()
    for child, until_s in zip(reversed(children), (ROBOTS_END_WITHIN_S, ALL_END_WITHIN_S)[-len(children) :], strict=False):
        child.ask_to_end()
        child.wait(start_s + until_s - time.monotonic())
    for child in children:
        child.kill()
    for child in children:
        child.wait_for_all(start_s + ALL_GONE_WITHIN_S - time.monotonic())
