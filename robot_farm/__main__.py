"""``python -m robot_farm``: one robot with ``--robot NAME``, otherwise ``--robots N`` of them."""

import ctypes
import os
import signal
import sys
import threading
from datetime import UTC, datetime

_PR_SET_PDEATHSIG = 1
_PR_SET_DUMPABLE = 4
_OF_THE_SUPERVISOR = ("--robots", "--first", "--farm-seed")


def say(text: str) -> None:
    """A line of the robot's log."""
    print(f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S.%fZ} {text}", flush=True)


def main() -> int:
    """Run robots until SIGTERM, SIGINT or the end of the parent process."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # before numpy is imported: many robots share few cores
    os.umask(0o077)  # whatever robots write, unfinished truth among it, is theirs alone
    from robot_farm.settings import FARM_SEED_VARIABLE, NOT_TAKEN, parse

    settings = parse(sys.argv[1:])
    if settings.farm_seed is not None:
        os.environ[FARM_SEED_VARIABLE] = str(settings.farm_seed)  # for the robots, whose command lines everybody can read
    stop, parent_pid = threading.Event(), os.getppid()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    system = ctypes.CDLL(None)
    system.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    system.prctl(_PR_SET_DUMPABLE, 0)  # no core files, and other processes of the user cannot look into memory or environment
    if settings.robot is None:
        from robot_farm.farm import run_robots

        threading.Thread(target=_watch_parent, args=(stop, parent_pid), daemon=True).start()
        run_robots(settings, _without_count(sys.argv[1:]), stop, say)
        return 0
    from robot_farm.link.api_link import NotAdmittedError
    from robot_farm.robot import Robot

    threading.Thread(target=_watch_parent, args=(stop, parent_pid), daemon=True).start()
    robot = Robot(settings.robot, settings, lambda text: say(f"{settings.robot}: {text}"))
    say(f"{settings.robot}: ready (pid {os.getpid()})")
    try:
        robot.live_until(stop)
    except NotAdmittedError as error:
        say(f"{settings.robot}: the farm does not take it: {error}")
        return NOT_TAKEN
    say(f"{settings.robot}: ended")
    return 0


def _watch_parent(stop: threading.Event, parent_pid: int) -> None:
    """Stop when the process that started this one has gone; for a thread of its own."""
    while not stop.wait(0.5):
        if os.getppid() != parent_pid:
            stop.set()


def _without_count(arguments: list[str]) -> list[str]:
    """The command line of a single robot: the supervisor's without its counts and the farm's seed."""
    kept, skip = [], False
    for argument in arguments:
        if skip:
            skip = False
        elif argument in _OF_THE_SUPERVISOR:
            skip = True
        elif not argument.startswith(tuple(f"{flag}=" for flag in _OF_THE_SUPERVISOR)):
            kept.append(argument)
    return kept


if __name__ == "__main__":
    sys.exit(main())
