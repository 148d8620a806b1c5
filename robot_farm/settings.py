"""What a robot process needs to know, from flags and from TRIFARM_ROBOT_TOKEN."""

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

TOKEN_VARIABLE = "TRIFARM_ROBOT_TOKEN"  # noqa: S105 - the name of a variable, not a secret


@dataclass(frozen=True)
class Settings:
    """Settings of one robot, or of the supervisor of several."""

    api: str
    bus: str
    farm: str
    data: Path
    physics: str
    token: str
    robots: int
    first: int
    robot: str | None

    def robot_folder(self, robot: str) -> Path:
        """Where a robot keeps the policies it fetched and the log it is writing."""
        return self.data / "robots" / robot


def parse(arguments: list[str]) -> Settings:
    """Settings from the command line; ends the process with a usage text if they are wrong."""
    parser = argparse.ArgumentParser(prog="python -m robot_farm", description="Run robots that take leases from a farm.")
    parser.add_argument("--robots", type=int, default=4, help="how many robots to run (default 4)")
    parser.add_argument("--first", type=int, default=0, help="number of the first robot, for farms on several machines")
    parser.add_argument("--robot", help="run one robot of this name in this process")
    parser.add_argument("--api", required=True, help="address of the API, such as http://127.0.0.1:8787")
    parser.add_argument("--bus", required=True, help="zenoh endpoint, such as tcp/127.0.0.1:7447")
    parser.add_argument("--farm", default="farm", help="name of the farm on the bus")
    parser.add_argument("--data", type=Path, required=True, help="folder for policies and unfinished logs")
    parser.add_argument("--physics", default="nominal", choices=["nominal"], help="physics of the robots")
    options = parser.parse_args(arguments)
    if options.robots < 1:
        parser.error(f"--robots is {options.robots}; it must be at least 1")
    token = os.environ.get(TOKEN_VARIABLE)
    if not token:
        parser.error(f"set {TOKEN_VARIABLE} to a token with the scope 'robot'")
    return Settings(
        api=options.api.rstrip("/"),
        bus=options.bus,
        farm=options.farm,
        data=options.data,
        physics=options.physics,
        token=token,
        robots=options.robots,
        first=options.first,
        robot=options.robot,
    )
