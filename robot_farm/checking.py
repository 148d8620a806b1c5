"""``python -m robot_farm.checking``: whether robots could be started with such physics and faults, before anything else is.

Prints one sentence and exits with 2 if they could not.
"""

import argparse
import sys
from collections.abc import Sequence

from api_schemas.tracker import TrackerName
from robot_farm.faults import Fault, parse_fault
from sim_backend.effects.ranges import load_ranges

EXIT_USAGE = 2


def check_robots(faults: Sequence[Fault], robots: Sequence[str]) -> None:
    """Raise ValueError if faults are to befall robots that there are not."""
    if strangers := {fault.robot for fault in faults} - set(robots):
        raise ValueError(f"--fault names {', '.join(sorted(strangers))}; the robots are {robots[0]} to {robots[-1]}")


def check_cameras() -> None:
    """Raise ValueError if this machine cannot render what a tracker on images needs."""
    from sim_backend.vision.cameras import Cameras, CamerasMissingError

    try:
        Cameras().close()
    except CamerasMissingError as error:
        raise ValueError(f"--tracker images: {error}") from error


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(prog="python -m robot_farm.checking", description="Check what robots would be told.")
    parser.add_argument("--robots", type=int, required=True, help="how many there are to be, from robot-0 on")
    parser.add_argument("--physics", required=True, help="nominal, mild, real, real-images, real-2 or a file with ranges")
    parser.add_argument("--fault", action="append", default=[], metavar="SPEC", help="of a robot; may be given several times")
    kinds = [kind.value for kind in TrackerName]
    parser.add_argument("--tracker", choices=kinds, default=TrackerName.POSE.value, help="what finds the object")
    options = parser.parse_args(arguments)
    try:
        if options.tracker == TrackerName.IMAGES:
            check_cameras()
        load_ranges(options.physics)
        check_robots([parse_fault(text) for text in options.fault], [f"robot-{number}" for number in range(options.robots)])
    except (ValueError, OSError) as error:
        print(error)
        return EXIT_USAGE
    return 0


if __name__ == "__main__":
    sys.exit(main())
