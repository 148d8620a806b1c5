"""What a farm's robots are to be like: the options of ``up`` and ``demo`` that are passed on to them."""

import subprocess
import tomllib
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from api_schemas.physics import NAMED_PHYSICS, physics_name
from api_schemas.tracker import TrackerName
from client_cli.embedded.child_process import child_environment, module_command
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from client_cli.terminal.wrong_values import meant
from jail.level import JailLevel

DEFAULT_PHYSICS = "real"
FARM_SEED_VARIABLE = "TRIFARM_FARM_SEED"
MAX_FARM_SEED = 2**63 - 1


class Reset(StrEnum):
    """How a robot puts the arena in order between two trials."""

    SWEEP = "sweep"
    PLACEMENT = "placement"


PhysicsOption = Annotated[
    str,
    typer.Option(
        "--physics",
        metavar="nominal|mild|real|real-images|real-2|FILE",
        help="Physics of the robots: nominal is ideal for all; the others differ by robot and are hidden.",
    ),
]
FarmSeedOption = Annotated[
    int | None,
    typer.Option(
        "--farm-seed", min=0, max=MAX_FARM_SEED, help="Seed of the robots' physics; by default a secret in the data folder."
    ),
]
ResetOption = Annotated[
    Reset | None,
    typer.Option(
        "--reset", help="Reset of the arena between trials; by default sweep, on nominal farms placement.", show_default=False
    ),
]
TrackerOption = Annotated[
    TrackerName,
    typer.Option(
        "--tracker",
        help="Source of the object's pose: a formula, or a network on rendered images of three cameras (slower; extra 'vision').",
    ),
]
FaultOption = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="ROBOT:KIND[:WHERE[:SIZE]][@TRIAL[+SECONDS]]",
        help="Fault of a robot, such as robot-1:stuck_joint:finger0_base_to_upper@2+3.5; repeatable. "
        "KIND is stuck_joint, encoder_jump (WHERE is a joint), dead_camera (WHERE is a camera) or controller_restart.",
    ),
]
JailOption = Annotated[
    JailLevel | None,
    typer.Option(
        "--jail-level",
        help="Minimum jail level; the farm refuses policies and uploads below it.",
        show_default="limits",
    ),
]


@dataclass(frozen=True)
class RobotOptions:
    """What the robots are told; ``physics`` is a name of NAMED_PHYSICS or the absolute path of a file."""

    count: int
    physics: str
    farm_seed: int | None = None
    reset: Reset | None = None
    faults: tuple[str, ...] = ()
    tracker: TrackerName = TrackerName.POSE

    @classmethod
    def of(
        cls,
        count: int,
        physics: str,
        farm_seed: int | None,
        reset: Reset | None,
        faults: list[str] | None,
        tracker: TrackerName = TrackerName.POSE,
    ) -> "RobotOptions":
        """The options as given on the command line, checked before anything starts.

        Raises:
            UsageProblem: there is no such physics or fault, or this machine cannot render what the tracker needs.
        """
        told = cls(count, usable_physics(physics), farm_seed, reset, tuple(faults or ()), tracker)
        if told.faults or told.physics not in NAMED_PHYSICS or tracker is not TrackerName.POSE:
            told._check()
        return told

    def _check(self) -> None:
        """Ask the robots' own program, which alone knows files of ranges and kinds of faults."""
        flags = [*self._tracker_flags(), *(part for fault in self.faults for part in ("--fault", fault))]
        command = module_command("robot_farm.checking", "--robots", str(self.count), "--physics", self.physics, *flags)
        ended = subprocess.run(command, env=child_environment(), capture_output=True, text=True, check=False)
        if ended.returncode == ExitCode.USAGE and ended.stdout:
            raise UsageProblem(ended.stdout.strip())
        if ended.returncode:
            raise ClientError(f"cannot check what the robots would be told: {ended.stderr.strip()[-500:]}")

    @property
    def physics_name(self) -> str:
        """What may be shown of the physics."""
        return physics_name(self.physics)

    def variables(self) -> dict[str, str]:
        """The part of what the robots are told that no command line may show."""
        return {} if self.farm_seed is None else {FARM_SEED_VARIABLE: str(self.farm_seed)}

    def flags(self) -> list[str]:
        """The command line of the robots; what was not asked for is left to their defaults."""
        flags = ["--robots", str(self.count), "--physics", self.physics]
        if self.reset is not None:
            flags += ["--reset", self.reset.value]
        flags += self._tracker_flags()
        return flags + [part for fault in self.faults for part in ("--fault", fault)]

    def _tracker_flags(self) -> list[str]:
        return [] if self.tracker is TrackerName.POSE else ["--tracker", self.tracker.value]


def usable_physics(given: str) -> str:
    """A named physics, or the absolute path of a file of ranges.

    Raises:
        UsageProblem: it is neither, or no TOML; what the ranges say is for the robots alone to judge.
    """
    if given in NAMED_PHYSICS:
        return given
    path = Path(given)
    if not path.is_file():
        choices = f"choose from {', '.join(NAMED_PHYSICS)}, or name a file of ranges"
        raise UsageProblem(f"there is no physics {given!r}: {choices}{meant(given, NAMED_PHYSICS)}")
    try:
        tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageProblem(f"{path} is no TOML file with ranges of physics: {error}") from error
    return str(path.absolute())
