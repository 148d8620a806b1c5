"""What each process of a farm's robots does at its start, and the whole life of a robot's."""

import ctypes
import os
import signal
import sys
import threading
from datetime import UTC, datetime

from robot_farm.settings import NO_ROOM, NOT_TAKEN, Settings
from trial_logs.disk import is_full, lose_words_rather_than_end

_PR_SET_PDEATHSIG = 1
_PR_SET_DUMPABLE = 4


def say(text: str) -> None:
    """A line of the robots' log; where the disk does not take it, it is lost (``lose_words_rather_than_end``)."""
    sys.stdout.write(f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S.%fZ} {text}\n")  # at once, so that robots' lines stay whole
    sys.stdout.flush()


def keep_to_itself() -> None:
    """What it writes, unfinished truth among it, and its memory are for this process alone; it outlives a full disk."""
    lose_words_rather_than_end()
    os.umask(0o077)
    ctypes.CDLL(None).prctl(_PR_SET_DUMPABLE, 0)  # no core files, and other processes of the user cannot look in


def ends_with(parent_pid: int) -> None:
    """Have the kernel ask this process to end when its parent does.

    Raises:
        SystemExit: the parent has ended already.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent_pid:
        sys.exit(1)


def stop_by_signal() -> threading.Event:
    """Set by SIGTERM and by SIGINT from now on."""
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    return stop


def live(robot_name: str, settings: Settings, stop: threading.Event) -> int:
    """Be one robot until told to stop; gives the exit code."""
    import zenoh

    from robot_farm.link.api_link import NotAdmittedError
    from robot_farm.robot import Robot

    try:
        robot = Robot(robot_name, settings, lambda text: say(f"{robot_name}: {text}"))
    except OSError as error:
        if not is_full(error):
            raise
        say(f"{robot_name}: cannot begin, the disk of {settings.robots_folder} is full: {error}")
        return NO_ROOM
    say(f"{robot_name}: ready (pid {os.getpid()})")
    try:
        robot.live_until(stop)
    except zenoh.ZError as error:
        say(f"{robot_name}: cannot come onto the bus, and tries again from its beginning: {str(error).partition(' at /')[0]}")
        return 1
    except NotAdmittedError as error:
        say(f"{robot_name}: the farm does not take it: {error}")
        return NOT_TAKEN
    say(f"{robot_name}: ended")
    return 0
