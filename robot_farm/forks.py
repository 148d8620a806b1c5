"""The farm's side of the warm parent: has it fork robots, who are children of the farm's own process, and notes which end."""

import ctypes
import os
import signal
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType

from robot_farm.settings import TOKEN_VARIABLE
from robot_farm.warm_parent import TITLE_ROOM_BYTES, Word

FORKED_WITHIN_S = 180.0
"""A warm parent that forks nothing for so long, compilation included, is killed, and another one started."""
NOT_FORKED = 70
"""Exit code of a robot that came to no process (``EX_SOFTWARE`` of ``sysexits.h``)."""
_PR_SET_CHILD_SUBREAPER = 36
_PID_BYTES = 32


class Forked:
    """A robot that was asked for; ``pid`` is None until it has a process, ``returncode`` (minus a signal) until it ended."""

    def __init__(self, link: socket.socket, word: Word) -> None:
        link.setblocking(False)
        self._link, self._word = link, word
        self._give_up_s = time.monotonic() + FORKED_WITHIN_S
        self.pid: int | None = None
        self.returncode: int | None = None

    def meet(self) -> None:
        """Take its pid and give it its word, if it is there by now: only who is known becomes a robot."""
        if self.pid is not None or self.returncode is not None:
            return
        try:
            told = self._link.recv(_PID_BYTES)
        except BlockingIOError:
            return
        except ConnectionError:
            told = b""
        if told:
            self.pid = int(told)
            with suppress(ConnectionError):  # it has ended, which its status will tell
                self._link.send(self._word.pack())
        else:
            self.returncode = NOT_FORKED
        self._link.close()

    def is_overdue(self) -> bool:
        """Whether it has been waited for too long."""
        return self.pid is None and self.returncode is None and time.monotonic() > self._give_up_s

    def end(self, number: signal.Signals) -> None:
        """Signal it; one that has no process yet will find nobody that waits for it."""
        if self.returncode is not None:
            return
        if self.pid is not None:
            os.kill(self.pid, number)
            return
        self._link.close()
        self.returncode = NOT_FORKED


class Forks:
    """Owner of the warm parent and of all children of this process: nothing else in it may wait for one.

    A context manager: at its end the warm parent is gone. Robots are the caller's to end; they outlive a warm parent.

    Args:
        arguments: the command line that all robots have besides their names.
        say: takes a line for the log.
    """

    def __init__(self, arguments: list[str], say: Callable[[str], None]) -> None:
        self._arguments, self._say = arguments, say
        self._warm: tuple[int, socket.socket] | None = None
        self._robots: list[Forked] = []

    def __enter__(self) -> "Forks":
        _take_orphans(True)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._warm is not None:
            pid, control = self._warm
            self._warm = None
            control.close()
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        _take_orphans(False)

    def robot(self, name: str, token: str) -> Forked:
        """Ask for a robot, which comes as soon as the warm parent, started anew where there is none, has time."""
        ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with its, suppress(ConnectionError):  # the warm parent has ended a moment ago: nobody holds the other end then
            socket.send_fds(self._control(), [b"."], [its.fileno()])
        asked = Forked(ours, Word(name, ("--robot", name, *self._arguments), token))
        self._robots.append(asked)
        return asked

    def look(self) -> None:
        """Note which robots have come and which have ended; kill a warm parent that hangs."""
        self._meet()
        with suppress(ChildProcessError):
            while (noted := os.waitpid(-1, os.WNOHANG))[0]:
                self._note(*noted)
        if self._warm is not None and any(each.is_overdue() for each in self._robots):
            os.kill(self._warm[0], signal.SIGKILL)

    def _meet(self) -> None:
        for each in self._robots:
            each.meet()
        self._robots = [each for each in self._robots if each.returncode is None]

    def _note(self, pid: int, status: int) -> None:
        """A child has ended: a robot, the warm parent, or an orphan of either, such as a robot's policy process."""
        self._meet()  # a robot may have told its pid and ended since
        for each in self._robots:
            if each.pid == pid:
                each.returncode = os.waitstatus_to_exitcode(status)
        if self._warm is not None and pid == self._warm[0]:
            self._warm[1].close()
            self._warm = None
            ended = how(os.waitstatus_to_exitcode(status))
            self._say(f"the warm parent (pid {pid}) ended with {ended}; the next robot is forked from another one")

    def _control(self) -> socket.socket:
        if self._warm is None:
            ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with its:
                os.set_inheritable(its.fileno(), True)
                room = "." * (len(" ".join(self._arguments).encode()) + TITLE_ROOM_BYTES)
                command = [sys.executable, "-P", "-m", "robot_farm.warm_parent", str(its.fileno()), room]
                # Whatever is in the warm parent is in every robot: the farm's token, which can speak for all of them, stays here.
                environment = {name: value for name, value in os.environ.items() if name != TOKEN_VARIABLE}
                self._warm = os.posix_spawn(sys.executable, command, environment), ours
        return self._warm[1]


def _take_orphans(takes: bool) -> None:
    """Whether what descends from this process and has lost its parent becomes its child."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, int(takes))


def how(returncode: int) -> str:
    """How a process ended, in words."""
    return f"signal {-returncode}" if returncode < 0 else f"exit code {returncode}"
