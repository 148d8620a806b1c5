"""A child process that does the work of a command in its place: writes to our stdout and stderr, and ends with us."""

import ctypes
import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from client_cli.embedded.child_process import child_environment
from client_cli.terminal.errors import Interrupted

TIME_TO_END_S = 5.0
"""What a child usually gets after Ctrl-C to leave its results in order."""
_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None)


def run_to_end(command: list[str], interrupted: str, *, ends_within_s: float = TIME_TO_END_S) -> int:
    """Exit code of a child that writes to our stdout and stderr.

    It gets a session of its own, so that a Ctrl-C reaches only us, and we end it together with the processes that it started. If
    we are killed the kernel ends it: nobody would know that it works on in a folder.

    Args:
        command: what to run.
        interrupted: the sentence for a Ctrl-C.
        ends_within_s: what the child gets after a Ctrl-C; whatever is left then is killed.

    Raises:
        Interrupted: by Ctrl-C, SIGTERM or SIGHUP, after the child has ended.
    """
    with _signals_as_interrupt():
        child = subprocess.Popen(
            command,
            env=child_environment(),
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=_end_with_parent,  # noqa: PLW1509 - of one thread, and it takes no lock
        )
        try:
            return child.wait()
        except KeyboardInterrupt:
            _signal_all(child, signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                child.wait(ends_within_s)
            raise Interrupted(interrupted) from None
        finally:
            _signal_all(child, signal.SIGKILL)
            child.wait()


def how_it_ended(code: int) -> str:
    """The end of a sentence about a child whose exit code is none that it should have."""
    if code >= 0:
        return f"ended with code {code}"
    return f"was ended by signal {-code}" + (" (out of memory?)" if -code == signal.SIGKILL else "")


def _end_with_parent() -> None:
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _signal_all(child: subprocess.Popen[bytes], number: signal.Signals) -> None:
    """Signal the child and its own children, which share its process group."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, number)


@contextmanager
def _signals_as_interrupt() -> Iterator[None]:
    """SIGTERM and SIGHUP act like Ctrl-C, since the child in its own session does not hear them; nohup's wish is kept."""
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
