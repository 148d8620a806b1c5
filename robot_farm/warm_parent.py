"""``python -m robot_farm.warm_parent FD ROOM``: has imported and compiled what robots need; they are forks that share its pages.

It has one thread, no session, no token, and no robot's physics: whatever is in its memory is in every robot's. Each robot gets
its word (command line and token) from the farm's process by a socket of its own, and becomes that process's child.
"""

import ctypes
import gc
import os
import signal
import socket
import sys
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from json import dumps, loads
from pathlib import Path

MAX_WORD_BYTES = 1 << 16
TITLE_ROOM_BYTES = 64
"""Of a robot's command line, for what it has before its arguments and its name."""
_REPARENTED_AFTER_S = 0.001


class ThreadsError(Exception):
    """Something that was imported has started a thread, which no fork would have."""


@dataclass(frozen=True)
class Word:
    """What a robot is told."""

    robot: str
    arguments: tuple[str, ...]
    token: str

    def pack(self) -> bytes:
        """As it goes through the socket."""
        return dumps(asdict(self)).encode()

    @classmethod
    def unpack(cls, packed: bytes) -> "Word":
        """From the socket."""
        told = loads(packed)
        return cls(told["robot"], tuple(told["arguments"]), told["token"])


def main() -> int:
    """Fork robots until the farm's process ends; each of them returns from here, too, when it has lived."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # before numpy is imported
    farm_pid = os.getppid()
    control, title = socket.socket(fileno=int(sys.argv[1])), _title_place()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches it, too; it ends with the farm's process
    from robot_farm.process import ends_with, keep_to_itself

    keep_to_itself()
    ends_with(farm_pid)
    gc.disable()
    _warm()
    _check_alone()
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    gc.freeze()  # a collection in a robot leaves these objects, and so their pages, alone
    link = _link_of_a_fork(control)
    return 0 if link is None else _be_robot(link, farm_pid, title)


def _warm() -> None:
    """Import, compile and find out all that is the same for all robots of this host."""
    from robot_farm.process import say
    from robot_farm.robot import host_jail
    from sim_backend import warm_up
    from sim_backend.driver.compilation import is_kept

    if not is_kept():
        say("compiling for the first time, about ten seconds")
    warm_up.main()
    host_jail()


def _check_alone() -> None:
    threads = [task.joinpath("comm").read_text().strip() for task in Path("/proc/self/task").iterdir()]
    if len(threads) > 1:
        raise ThreadsError(f"robots cannot be forked from a process with {len(threads)} threads: {', '.join(threads)}")


def _link_of_a_fork(control: socket.socket) -> socket.socket | None:
    """Fork a robot for each socket that comes; gives it in the robot. None in the parent when no more can come."""
    while True:
        message, descriptors, _, _ = socket.recv_fds(control, 1, 1)
        if not message:
            return None
        with socket.socket(fileno=descriptors[0]) as link:
            if _is_robot():
                control.close()
                return link.dup()


def _is_robot() -> bool:
    """Fork twice: true in the robot, which has become the child of the nearest ancestor that takes orphans; false in the parent.

    The robot begins when that has happened. Should a fork fail, the robot's socket is closed, by which its farm knows.
    """
    try:
        between = os.fork()
    except OSError:
        return False
    if between:
        os.waitpid(between, 0)
        return False
    between = os.getpid()
    try:
        robot = os.fork()
    except OSError:
        os._exit(1)
    if robot:
        os._exit(0)
    while os.getppid() == between:
        time.sleep(_REPARENTED_AFTER_S)
    return True


def _be_robot(link: socket.socket, farm_pid: int, title: tuple[int, int]) -> int:
    """Tell the farm's process who it is, get the word, and live."""
    import numpy as np

    from robot_farm.process import end_by_signal, ends_with, live
    from robot_farm.settings import TOKEN_VARIABLE, parse

    ending = end_by_signal()
    ends_with(farm_pid)
    with link, suppress(ConnectionError):
        link.send(str(os.getpid()).encode())
        packed = link.recv(MAX_WORD_BYTES)
    if not packed:
        return 1  # nobody waits for it any more
    word = Word.unpack(packed)
    _call_itself([sys.executable, "-P", "-m", "robot_farm", *word.arguments], title)
    gc.enable()
    np.random.seed()  # the one state of numpy that forks share; Python's own is drawn anew by each fork
    os.environ[TOKEN_VARIABLE] = word.token
    return live(word.robot, parse(list(word.arguments)), ending)


def _title_place() -> tuple[int, int]:
    """Where this process's command line lies in memory, from and to; ``/proc/self/stat`` calls it arg_start and arg_end."""
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    return int(fields[45]), int(fields[46])


def _call_itself(command: list[str], place: tuple[int, int]) -> None:
    """Show ``command`` as this process's command line, as ``ps`` and ``pgrep -f`` read it.

    What does not end with a zero byte is shown up to the first one, as the kernel does for programs that call setproctitle.
    """
    begin, end = place
    room = end - begin
    shown = " ".join(command).encode()[: room - 2]
    ctypes.memmove(begin, shown + bytes(room - 1 - len(shown)) + b".", room)


if __name__ == "__main__":
    sys.exit(main())
