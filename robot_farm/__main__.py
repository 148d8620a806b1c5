"""``python -m robot_farm``: one robot with ``--robot NAME``, otherwise ``--robots N`` of them."""

import os
import sys
from collections.abc import Callable

_OF_THE_SUPERVISOR = ("--robots", "--first", "--farm-seed")


def main() -> int:
    """Run robots until SIGTERM, SIGINT or the end of the parent process."""
    parent_pid = os.getppid()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # before numpy is imported: many robots share few cores
    from robot_farm.process import end_by_signal, ends_with, keep_to_itself, live, say

    ending = end_by_signal()  # at once: a container's first process is not ended by a signal that it has not asked for
    from robot_farm.settings import FARM_SEED_VARIABLE, parse

    keep_to_itself()
    settings = parse(sys.argv[1:])
    if settings.farm_seed is not None:
        os.environ[FARM_SEED_VARIABLE] = str(settings.farm_seed)  # for the robots, whose command lines everybody can read
    ends_with(parent_pid)
    _tell_unknown_settings(say)
    if settings.robot is not None:
        return live(settings.robot, settings, ending)
    from robot_farm.farm import run_robots

    ending.drain_s = settings.drain_s
    run_robots(settings, _without_count(sys.argv[1:]), ending, say)
    return 0


def _tell_unknown_settings(say: Callable[[str], None]) -> None:
    """Says which variables nobody reads, and takes them out, so that each robot that is started does not say it, too."""
    from api_schemas.environment import unknown_settings

    for name, said in unknown_settings(os.environ).items():
        say(f"warning: {said}")
        del os.environ[name]


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
