"""``python -m robot_farm``: one robot with ``--robot NAME``, otherwise ``--robots N`` of them."""

import ctypes
import os
import signal
import sys
import threading
from datetime import UTC, datetime

_PR_SET_PDEATHSIG = 1


def say(text: str) -> None:
    """A line of the robot's log."""
    print(f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S.%fZ} {text}", flush=True)


def main() -> int:
    """Run robots until SIGTERM, SIGINT or the end of the parent process."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # before numpy is imported: many robots share few cores
    from robot_farm.settings import parse

    settings = parse(sys.argv[1:])
    stop, parent_pid = threading.Event(), os.getppid()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if settings.robot is None:
        from robot_farm.farm import run_robots
        from robot_farm.watch import watch_parent

        threading.Thread(target=watch_parent, args=(stop, parent_pid), daemon=True).start()
        run_robots(settings, _without_count(sys.argv[1:]), stop, say)
        return 0
    from robot_farm.robot import Robot
    from robot_farm.watch import watch_parent

    threading.Thread(target=watch_parent, args=(stop, parent_pid), daemon=True).start()
    robot = Robot(settings.robot, settings, lambda text: say(f"{settings.robot}: {text}"))
    say(f"{settings.robot}: ready (pid {os.getpid()})")
    robot.live_until(stop)
    say(f"{settings.robot}: ended")
    return 0


def _without_count(arguments: list[str]) -> list[str]:
    """The command line of a single robot: the supervisor's without its counts."""
    kept, skip = [], False
    for argument in arguments:
        if skip:
            skip = False
        elif argument in ("--robots", "--first"):
            skip = True
        elif not argument.startswith(("--robots=", "--first=")):
            kept.append(argument)
    return kept


if __name__ == "__main__":
    sys.exit(main())
