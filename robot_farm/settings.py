"""What a robot process needs to know, from flags and from TRIFARM_ROBOT_TOKEN and TRIFARM_FARM_SEED."""

import argparse
import math
import os
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from api_schemas.physics import NOMINAL, physics_name
from api_schemas.tracker import TrackerName
from jail.level import JailLevel
from robot_farm.checking import check_robots
from robot_farm.faults import FORM, Fault, parse_fault
from robot_farm.reserve import TRIAL_BYTES
from sim_backend.effects.ranges import load_ranges

FARM_SEED_VARIABLE = "TRIFARM_FARM_SEED"
"""The farm's seed as its robots are told: in the environment, which nobody else can read, unlike a command line."""
TOKEN_VARIABLE = "TRIFARM_ROBOT_TOKEN"  # noqa: S105 - the name of a variable, not a secret
NOT_TAKEN = 77
"""Exit code of a robot that the farm does not take (``EX_NOPERM`` of ``sysexits.h``)."""
NO_ROOM = 73
"""Exit code of a robot that could not begin on a full disk (``EX_CANTCREAT``)."""
CA_VARIABLE = "TRIFARM_CA"
RESERVE_VARIABLE = "TRIFARM_ROBOT_RESERVE_BYTES"
ALIVE_VARIABLE = "TRIFARM_ALIVE_FILE"
JAIL_LEVEL_VARIABLE = "TRIFARM_JAIL_LEVEL"
DATA = "robot-data"
FREE = "free"
SELF_TEST_EVERY = 5
LONGEST_DRAIN_S = 86_400.0


class Reset(StrEnum):
    """How the arena is made ready for a trial."""

    SWEEP = "sweep"  # the fingers bring the object back; the trial starts from where it lies
    PLACEMENT = "placement"  # the object is put where the trial's seed says


@dataclass(frozen=True)
class Settings:
    """Settings of one robot, or of the supervisor of several."""

    api: str
    bus: str | None
    """Where the bus is, if not where the API says."""
    farm: str | None
    """The farm's name on the bus, if not as the API says."""
    data: Path
    token: str
    robots: int
    first: int | None
    """None: the first numbers that are free."""
    robot: str | None
    physics: str
    farm_seed: int | None
    reset: Reset
    faults: tuple[Fault, ...]
    fault_rate: float
    self_test_every: int
    ca: Path | None = None
    """Certificates that vouch for the API's."""
    jail_level: JailLevel = JailLevel.LIMITS
    """A robot whose policies cannot be shut in as closely as this is out of service."""
    alive_file: Path | None = None
    """Touched with each heartbeat, for the health check of a container."""
    tracker: TrackerName = TrackerName.POSE
    reserve_bytes: int = TRIAL_BYTES
    """What a robot keeps free on its disk for its next trial."""
    drain_s: float = 0.0
    """So long a robot that was asked to end may take to finish its trial; a second signal ends it at once."""

    def robot_folder(self, robot: str) -> Path:
        """Where a robot keeps the policies it fetched and the log it is writing."""
        return self.robots_folder / robot

    @property
    def robots_folder(self) -> Path:
        """Where the robots of this machine keep what is theirs."""
        return self.data / "robots"

    @property
    def physics_name(self) -> str:
        """The robots' physics as they are told to others."""
        return physics_name(self.physics)

    @property
    def robot_names(self) -> tuple[str, ...]:
        """The robots of a supervisor that was told the first; none if it looks for free ones."""
        return () if self.first is None else tuple(f"robot-{self.first + index}" for index in range(self.robots))

    @property
    def is_plain(self) -> bool:
        """Whether all robots are the same ideal one, always placed and never at fault: its life is one without effects."""
        return self.physics == NOMINAL and self.reset is Reset.PLACEMENT and not self.faults and self.fault_rate == 0.0


def parse(arguments: list[str]) -> Settings:
    """Settings from the command line; ends the process with a usage text if they are wrong."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.jail_level not in set(JailLevel):
        parser.error(f"{JAIL_LEVEL_VARIABLE} is {options.jail_level!r}; choose from {', '.join(JailLevel)}")
    if options.ca is not None and not options.ca.is_file():
        parser.error(f"--ca is {options.ca}, which is no file; it must be a PEM file with the certificates to trust")
    if options.robots < 1:
        parser.error(f"--robots is {options.robots}; it must be at least 1")
    if options.self_test_every < 1:
        parser.error(f"--self-test-every is {options.self_test_every}; it must be at least 1")
    if not 0.0 <= options.fault_rate <= 1.0:
        parser.error(f"--fault-rate is {options.fault_rate:g}; it must be between 0 and 1")
    try:
        load_ranges(options.physics)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    token = os.environ.get(TOKEN_VARIABLE)
    if not token:
        parser.error(f"set {TOKEN_VARIABLE} to a token with the scope 'robot'")
    try:
        farm_seed = options.farm_seed if options.farm_seed is not None else given_seed()
    except ValueError as error:
        parser.error(str(error))
    reset = options.reset or (Reset.PLACEMENT if options.physics == NOMINAL else Reset.SWEEP)
    settings = Settings(
        api=options.api.rstrip("/"),
        bus=options.bus,
        farm=options.farm,
        data=options.data.absolute(),  # policies run in another folder
        token=token,
        robots=options.robots,
        first=options.first,
        robot=options.robot,
        physics=options.physics,
        farm_seed=farm_seed,
        reset=Reset(reset),
        faults=tuple(options.fault),
        fault_rate=options.fault_rate,
        self_test_every=options.self_test_every,
        jail_level=JailLevel(options.jail_level),
        ca=options.ca,
        alive_file=Path(alive) if (alive := os.environ.get(ALIVE_VARIABLE)) else None,
        reserve_bytes=options.reserve_bytes,
        tracker=TrackerName(options.tracker),
        drain_s=options.drain_s,
    )
    if settings.robot is None and settings.first is not None:  # a single robot is told everybody's faults
        try:
            check_robots(settings.faults, settings.robot_names)
        except ValueError as error:
            parser.error(str(error))
    return settings


def given_seed() -> int | None:
    """The farm's seed in the environment, None if there is none.

    Raises:
        ValueError: it is no whole number of 0 or more.
    """
    text = os.environ.get(FARM_SEED_VARIABLE, "")
    if not text:
        return None
    if not (text.isascii() and text.isdigit()):
        raise ValueError(f"{FARM_SEED_VARIABLE} is {text!r}; it must be a whole number of 0 or more")
    return int(text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m robot_farm", description="Run robots that take leases from a farm.")
    parser.add_argument("--robots", type=int, default=4, help="how many robots to run (default 4)")
    first = "number of the first robot, for farms on several machines; 'free' takes those that no process on this --data has"
    parser.add_argument("--first", type=_first, default=0, help=first)
    parser.add_argument("--robot", help="run one robot of this name in this process")
    parser.add_argument("--api", required=True, help="address of the API, such as http://127.0.0.1:8787")
    parser.add_argument("--bus", help="zenoh endpoint, such as tcp/127.0.0.1:7447 (default: what the API says)")
    parser.add_argument("--farm", help="name of the farm on the bus (default: what the API says)")
    data = f"folder for policies and unfinished logs (default {DATA})"
    parser.add_argument("--data", type=Path, default=Path(DATA), help=data)
    parser.add_argument(
        "--physics", default="real", help="nominal, mild, real, real-images, real-2 or a file with ranges (default real)"
    )
    seed = f"draw the robots' physics from this seed instead of the farm's secret (default: {FARM_SEED_VARIABLE})"
    parser.add_argument("--farm-seed", type=int, help=seed)
    reset = "how the arena is made ready: sweep or placement (default: sweep; placement with nominal physics)"
    parser.add_argument("--reset", choices=[reset.value for reset in Reset], help=reset)
    kinds, sees = [kind.value for kind in TrackerName], "what finds the object: a formula, or a tracker on images (default pose)"
    parser.add_argument("--tracker", choices=kinds, default=TrackerName.POSE.value, help=sees)
    parser.add_argument("--fault", type=_fault, action="append", default=[], metavar="SPEC", help=f"a fault: {FORM}")
    parser.add_argument("--fault-rate", type=float, default=0.0, help="probability of a drawn fault in each trial (default 0)")
    named = os.environ.get(CA_VARIABLE)
    ca = f"PEM file with the certificates that vouch for the API's (default: {CA_VARIABLE}, or those of this machine)"
    parser.add_argument("--ca", type=Path, default=Path(named) if named else None, help=ca)
    jail = f"serve only where the jail of policies reaches this level (default: {JAIL_LEVEL_VARIABLE}, or {JailLevel.LIMITS})"
    levels, usual = [level.value for level in JailLevel], os.environ.get(JAIL_LEVEL_VARIABLE, JailLevel.LIMITS.value)
    parser.add_argument("--jail-level", choices=levels, default=usual, help=jail)
    reserve = f"what each robot keeps free on its disk for a trial; 0: nothing (default: {RESERVE_VARIABLE}, or {TRIAL_BYTES})"
    kept = os.environ.get(RESERVE_VARIABLE, str(TRIAL_BYTES))
    parser.add_argument("--reserve-bytes", type=_count, default=kept, metavar="BYTES", help=reserve)
    drain = "after SIGTERM finish the trial, for so long at the most; a second signal ends it at once (default 0: give it back)"
    parser.add_argument("--drain-s", type=_seconds, default=0.0, metavar="SECONDS", help=drain)
    every = f"trials from one self-test to the next (default {SELF_TEST_EVERY})"
    parser.add_argument("--self-test-every", type=int, default=SELF_TEST_EVERY, help=every)
    return parser


def _first(text: str) -> int | None:
    if text == FREE:
        return None
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f"{text!r} is neither a whole number of 0 or more nor {FREE!r}")
    return int(text)


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= 15):
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number of bytes of 0 or more")
    return int(text)


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0.0 <= seconds <= LONGEST_DRAIN_S:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds from 0 to {LONGEST_DRAIN_S:.0f}")
    return seconds


def _fault(text: str) -> Fault:
    try:
        return parse_fault(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
