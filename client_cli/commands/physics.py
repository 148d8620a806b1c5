"""``trifarm physics`` and ``effects``: what one robot of this machine's farm has, and what any robot may have; for operators."""

from pathlib import Path
from typing import Annotated

import typer

from client_cli.embedded.child_process import module_command
from client_cli.embedded.record import load_record
from client_cli.embedded.robot_options import FarmSeedOption, usable_physics
from client_cli.terminal.child_answer import answer_of, pass_on
from client_cli.terminal.errors import UsageProblem
from client_cli.terminal.options import JsonOption


def physics(
    robot: Annotated[str, typer.Option("--robot", metavar="ROBOT", help="Robot name, such as robot-2.")],
    data: Annotated[Path, typer.Option("--data", metavar="DIR", help="Data folder of the farm.")],
    told: Annotated[
        str | None,
        typer.Option(
            "--physics",
            metavar="nominal|mild|real|real-images|real-2|FILE",
            help="Physics of a farm that 'trifarm up' did not start.",
        ),
    ] = None,
    farm_seed: FarmSeedOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print a robot's hidden physics from the data folder; the server never shows it."""
    if not data.is_dir():
        raise UsageProblem(f"there is no data folder {data}")
    record = load_record(data) if told is None else None
    if told is None and record is None:
        raise UsageProblem(f"no 'trifarm up' ran on {data}: say with --physics what its robots were told")
    seed = record.farm_seed if record is not None and farm_seed is None else farm_seed
    flags = ["--data", str(data.absolute()), "--robot", robot]
    flags += ["--physics", usable_physics(record.physics if record is not None else told or "")]
    flags += ([] if seed is None else ["--farm-seed", str(seed)]) + (["--json"] if as_json else [])
    # Only the robots' own code may look.
    pass_on("physics", answer_of(module_command("robot_farm.hidden_physics", *flags)))


def effects(as_json: JsonOption = False) -> None:
    """List all effects with the bounds, units and sources of their parameters."""
    flags = ["--json"] if as_json else []
    pass_on("effects", answer_of(module_command("sim_backend.effects", *flags)))
