"""Child processes of the services: nothing of this process's environment, no standard error, an end after a deadline."""

import asyncio
import os
import signal
import sys
from dataclasses import dataclass
from pathlib import Path

from jail.environment import jail_environment

MAX_SAID_BYTES = 64 * 1024


class ChildKilledError(Exception):
    """The child did not end by itself; the message says why it was killed."""


class ChildTimedOutError(ChildKilledError):
    """The child did not end in time."""


class ChildSaidTooMuchError(ChildKilledError):
    """The child said more than anybody wants to read."""


@dataclass(frozen=True)
class Ended:
    """How a child ended, and what it had said; a negative status is the signal that ended it."""

    status: int
    said: bytes

    @property
    def how(self) -> str:
        """The end of a sentence that begins with the process."""
        return f"was ended by signal {-self.status}" if self.status < 0 else f"ended with status {self.status}"


async def run_module(module: str, *arguments: str, folder: Path, deadline_s: float) -> Ended:
    """Runs a module of this installation in ``folder``, which it is to see as its working folder and may come to own.

    Whatever is left of it and its own children is killed in the end. The module enters its jail by itself.

    Raises:
        ChildTimedOutError: it took longer than ``deadline_s``.
        ChildSaidTooMuchError: it said more than ``MAX_SAID_BYTES``.
    """
    child = await asyncio.create_subprocess_exec(
        *(sys.executable, "-P", "-m", module, *arguments),
        cwd=folder,
        env=jail_environment(),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        async with asyncio.timeout(deadline_s):
            said = await _read(child.stdout)
            await child.wait()
    except TimeoutError as error:
        raise ChildTimedOutError(f"it took more than {deadline_s:g} s") from error
    finally:
        if child.returncode is None:
            os.killpg(child.pid, signal.SIGKILL)
            await child.communicate()  # no more than the pipe holds
    return Ended(child.returncode or 0, said)


async def _read(stream: asyncio.StreamReader | None) -> bytes:
    assert stream is not None, "the child's standard output is a pipe"
    said = bytearray()
    while chunk := await stream.read(MAX_SAID_BYTES):
        said += chunk
        if len(said) > MAX_SAID_BYTES:
            raise ChildSaidTooMuchError(f"it said more than {MAX_SAID_BYTES} bytes")
    return bytes(said)
