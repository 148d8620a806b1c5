"""Re-simulates a trial from its log: ``python -m sim_backend.replay LOG [--verify] [--json]``.

The recorded applied torques drive the nominal model from the recorded start; a true log gives the same numbers, bit for bit.
Exit codes: 0 same (or shown), 6 the numbers differ, 1 the log cannot be read.
"""

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from api_schemas.trial_log_reader import LogUnreadableError, TrialLog, read_log

EXIT_UNREADABLE = 1
EXIT_DIFFERS = 6


@dataclass(frozen=True)
class Verification:
    """What a replay found. ``first_difference_step`` is the first step whose numbers differ, None if there is none."""

    trial_id: str
    steps: int
    same: bool
    first_difference_step: int | None
    largest_joint_difference_rad: float
    largest_cube_difference_m: float


def verify(log: TrialLog) -> Verification:
    """Compare a log's joint states and true cube poses with a new simulation of its applied torques.

    Raises:
        LogUnreadableError: the log has gaps or no start, so that there is nothing to compare.
    """
    from sim_backend.driver.driver import Start
    from sim_backend.driver.simulated import SimulatedDriver

    steps = len(log.joint_steps)
    if steps == 0 or len(log.applied_torque_nm) != steps or (log.joint_steps != np.arange(steps)).any():
        raise LogUnreadableError("the log does not have one joint state and one torque for every millisecond from the start")
    if not len(log.cube_steps) or log.cube_steps[0] != 0:
        raise LogUnreadableError("the log has no true cube pose at the start, so that it cannot be simulated again")
    driver = SimulatedDriver(safety=False)
    driver.reset(Start(log.joint_position_rad[:1], log.cube_position_world_m[:1], log.cube_quat_wxyz[:1]))
    segment = driver.advance_torques(np.ascontiguousarray(log.applied_torque_nm[None]))
    position = np.abs(segment.joint_position_rad[0] - log.joint_position_rad)
    velocity = np.abs(segment.joint_velocity_rad_s[0] - log.joint_velocity_rad_s)
    cube = np.abs(segment.cube_position_world_m[0][log.cube_steps] - log.cube_position_world_m)
    turned = np.abs(segment.cube_quat_wxyz[0][log.cube_steps] - log.cube_quat_wxyz)
    different = [
        *np.flatnonzero((position != 0).any(axis=1) | (velocity != 0).any(axis=1)).tolist()[:1],
        *log.cube_steps[np.flatnonzero((cube != 0).any(axis=1) | (turned != 0).any(axis=1))].tolist()[:1],
    ]
    return Verification(
        trial_id=log.metadata.get("trial_id", ""),
        steps=steps,
        same=not different,
        first_difference_step=min(different, default=None),
        largest_joint_difference_rad=float(position.max()),
        largest_cube_difference_m=float(cube.max()),
    )


def _summary(log: TrialLog) -> dict:
    return {
        "trial": log.metadata,
        "outcome": log.outcome,
        "simulated_s": len(log.joint_steps) / 1000,
        "joint_states": len(log.joint_steps),
        "tracked_poses": len(log.capture_s),
        "messages": log.message_counts,
    }


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(prog="trifarm replay", description="Show a trial's log, or simulate it again and compare.")
    parser.add_argument("log", type=Path, help="an MCAP file written by a robot of the farm")
    parser.add_argument("--verify", action="store_true", help="simulate the applied torques again and compare every number")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args(arguments)
    try:
        log = read_log(options.log)
        if not options.verify:
            print(json.dumps(_summary(log), indent=None if options.json else 2))
            return 0
        result = verify(log)
    except LogUnreadableError as error:
        print(
            json.dumps({"error": str(error)}) if options.json else f"error: {error}",
            file=sys.stdout if options.json else sys.stderr,
        )
        return EXIT_UNREADABLE
    if options.json:
        print(json.dumps(asdict(result)))
    elif result.same:
        print(f"{options.log.name}: same numbers in all {result.steps} steps")
    else:
        print(
            f"{options.log.name}: differs from step {result.first_difference_step} on (by up to "
            f"{result.largest_joint_difference_rad:.3g} rad at the joints, {result.largest_cube_difference_m:.3g} m at the cube)"
        )
    return 0 if result.same else EXIT_DIFFERS


if __name__ == "__main__":
    sys.exit(main())
