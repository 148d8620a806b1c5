"""``trifarm up``: a whole farm on this machine with one command."""

import os
import time
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.tracker import TrackerName
from client_cli.connection.settings import DEFAULT_PORT, default_data_folder, home_folder
from client_cli.embedded.claims import private_files
from client_cli.embedded.farm import EmbeddedFarm, FarmOptions, embedded_farm
from client_cli.embedded.robot_options import (
    DEFAULT_PHYSICS,
    FarmSeedOption,
    FaultOption,
    JailOption,
    PhysicsOption,
    ResetOption,
    RobotOptions,
    TrackerOption,
)
from client_cli.embedded.settings_loan import former_entry, put_back
from client_cli.terminal.errors import ClientError
from client_cli.terminal.options import JsonOption, RobotsOption
from client_cli.terminal.output import counted, note, print_document, print_line

WATCH_EVERY_S = 0.2


def up(
    robots: RobotsOption = 4,
    data: Annotated[
        Path | None,
        typer.Option("--data", metavar="DIR", help="Folder of database, policies and logs.", show_default=False),
    ] = None,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port of the API; 0 takes any free one.")] = DEFAULT_PORT,
    physics: PhysicsOption = DEFAULT_PHYSICS,
    farm_seed: FarmSeedOption = None,
    reset: ResetOption = None,
    fault: FaultOption = None,
    tracker: TrackerOption = TrackerName.POSE,
    jail_level: JailOption = None,
    as_json: JsonOption = False,
) -> None:
    """Start a farm with API, dispatcher and robots, and keep it running until Ctrl-C."""
    folder = (data or default_data_folder(os.environ)).absolute()
    told = RobotOptions.of(robots, physics, farm_seed, reset, fault, tracker)
    options = FarmOptions(data=folder, home=home_folder(os.environ), port=port, robots=told, jail_level=jail_level)
    try:
        note(f"starting {counted(robots, 'robot')}; data in {folder}")
        former = former_entry(options.home)
        with private_files(), embedded_farm(options) as farm, put_back(former, farm.connection, farm.settings):
            if as_json:
                print_document(document(farm))
            else:
                print_line(welcome(farm))
            _keep_running(farm)
    except KeyboardInterrupt:
        note("the farm is stopped")


def _keep_running(farm: EmbeddedFarm) -> None:
    while True:
        time.sleep(WATCH_EVERY_S)
        try:
            farm.check()
        except ClientError as error:
            raise ClientError(error.detail, after_document=True) from error


def document(farm: EmbeddedFarm) -> dict[str, object]:
    """A ready farm as JSON; the token itself stays in the settings file."""
    return {
        "url": farm.connection.url,
        "bus": farm.bus,
        "robots": farm.robots,
        "physics": farm.physics,
        "data": str(farm.data),
        "logs": str(farm.data / "logs"),
        "settings": str(farm.settings),
        "pid": os.getpid(),
    }


def welcome(farm: EmbeddedFarm) -> str:
    """What a newcomer needs next."""
    lines = [
        f"The farm is up: {counted(farm.robots, 'robot')} with {farm.physics} physics at {farm.connection.url}",
        f"  token      in {farm.settings}, where trifarm finds it",
        f"  data       {farm.data}",
        f"  logs       {farm.data / 'logs'}",
        "In another terminal:",
        "  trifarm submit FILE --task push --wait     (FILE with its manifest FILE.json, or --manifest, or --layout)",
        "  trifarm robots",
        "  trifarm status",
        "Ctrl-C stops everything.",
    ]
    hiding = [name for name in ("TRIFARM_URL", "TRIFARM_TOKEN") if os.environ.get(name)]
    if hiding:
        lines.insert(-1, f"Note: {' and '.join(hiding)} in the environment win over the settings file.")
    return "\n".join(lines)
