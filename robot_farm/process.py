"""What each process of a farm's robots does at its start, and the whole life of a robot's."""

import ctypes
import os
import signal
import sys
import threading
from contextlib import suppress
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


class Ending:
    """When a process is to end: at a first signal it takes nothing new, and what is under way has ``drain_s`` to be finished.

    A second signal, a ``drain_s`` of 0, or the death of the parent, who looks after it, ends that, too.
    """

    def __init__(self, drain_s: float = 0.0) -> None:
        self.drain_s, self._parent_pid = drain_s, os.getppid()
        self.leaving, self.stop = threading.Event(), threading.Event()

    def begin(self) -> None:
        """What each signal does."""
        is_first = not self.leaving.is_set()
        self.leaving.set()
        if is_first and self.drain_s > 0.0 and os.getppid() == self._parent_pid:
            patience = threading.Timer(self.drain_s, self.stop.set)
            patience.daemon = True
            with suppress(RuntimeError):  # no thread can be had: then at once
                patience.start()
                return
        self.stop.set()


def end_by_signal() -> Ending:
    """Begun by SIGTERM and by SIGINT from now on."""
    ending = Ending()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ending.begin())
    return ending


def live(robot_name: str, settings: Settings, ending: Ending) -> int:
    """Be one robot until told to end; gives the exit code."""
    import zenoh

    from robot_farm.link.api_link import NotAdmittedError
    from robot_farm.robot import Robot

    ending.drain_s = settings.drain_s
    try:
        robot = Robot(robot_name, settings, lambda text: say(f"{robot_name}: {text}"))
    except OSError as error:
        if not is_full(error):
            raise
        say(f"{robot_name}: cannot begin, the disk of {settings.robots_folder} is full: {error}")
        return NO_ROOM
    say(f"{robot_name}: ready (pid {os.getpid()})")
    try:
        robot.live_until(ending)
    except zenoh.ZError as error:
        say(f"{robot_name}: cannot come onto the bus, and tries again from its beginning: {str(error).partition(' at /')[0]}")
        return 1
    except NotAdmittedError as error:
        say(f"{robot_name}: the farm does not take it: {error}")
        return NOT_TAKEN
    say(f"{robot_name}: ended")
    return 0
