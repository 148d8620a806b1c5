"""Closes the jail around this process, from its limits to its system calls; what the machine does not have is left out."""

import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from jail import kernel, landlock, seccomp
from jail.level import Jail, Layer
from jail.needs import Needs
from jail.system_calls import machine

FIRST_USER = 2_000_000_000
"""Each jail of a farm that runs as root has a user of its own, this number plus its process id: no other process has it, so that
a limit on processes binds and no jailed process can touch another one."""
NOBODY = 65534
"""The user where a container maps too few for that."""


class JailError(Exception):
    """The jail cannot be closed around a process as it is now; a mistake in the farm's own code."""


def end_with_parent(parent_pid: int) -> None:
    """Has the kernel kill this process when its parent ends; a child that computes for ever would never notice otherwise."""
    with suppress(OSError):
        kernel.prctl(kernel.PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent_pid:
        sys.exit(1)  # it ended before the line above


def enter(needs: Needs) -> Jail:
    """Closes the jail; there is no way back. Call it before anything looks at what a user sent.

    What the process needs but cannot reach from inside, such as imports without an installation, it has to get before.

    Returns:
        The layers that are active; the caller tells its parent.

    Raises:
        JailError: other threads run, which most layers would leave outside.
    """
    _check_alone()
    parent_pid = os.getppid()
    layers: set[Layer] = set()
    for close in _closing(needs, layers):
        with suppress(OSError):
            layers |= close()
    end_with_parent(parent_pid)  # only now: a change of the user makes the kernel forget it
    if (on := machine()) is not None:
        with suppress(OSError):
            seccomp.restrict(on, files=needs.files, executable_memory=needs.installation)
            layers.add(Layer.SYSTEM_CALLS)
    return Jail.of(layers)


def _closing(needs: Needs, layers: set[Layer]) -> Iterator[Callable[[], set[Layer]]]:
    """Closes the layers in their order, each of which needs rights that a later one takes away; ``layers`` are closed already."""
    yield lambda: _limit(needs)
    yield _leave_network
    yield _give_up_new_privileges
    yield lambda: landlock.restrict(needs.readable, needs.writable)
    yield lambda: _become_nobody(needs, layers)


def _check_alone() -> None:
    with suppress(FileNotFoundError):
        threads = len(list(Path("/proc/self/task").iterdir()))
        if threads != 1:
            raise JailError(f"{threads} threads run already; enter the jail before any but the first")


def _limit(needs: Needs) -> set[Layer]:
    limits = {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_AS: needs.memory_bytes,
        resource.RLIMIT_FSIZE: needs.file_bytes,
        resource.RLIMIT_NOFILE: needs.open_files,
    }
    if needs.cpu_s is not None:
        limits[resource.RLIMIT_CPU] = needs.cpu_s
    for limit, value in limits.items():
        _lower(limit, value)
    return {Layer.LIMITS}


def _lower(limit: int, value: int) -> None:
    """Sets a limit, never above what it is already."""
    _, hard = resource.getrlimit(limit)
    least = value if hard == resource.RLIM_INFINITY else min(value, hard)
    resource.setrlimit(limit, (least, least))


def _leave_network() -> set[Layer]:
    """A network of its own with nothing in it; takes the right to make one, which root has."""
    kernel.unshare(kernel.CLONE_NEWNET)
    return {Layer.NETWORK_NAMESPACE}


def _give_up_new_privileges() -> set[Layer]:
    kernel.prctl(kernel.PR_SET_NO_NEW_PRIVS, 1)
    return {Layer.NO_NEW_PRIVILEGES}


def _become_nobody(needs: Needs, layers: set[Layer]) -> set[Layer]:
    """A process of root becomes one of a user that owns nothing but its folder; any other one is not root's already.

    Where the installation is closed to that user, it keeps the one right to read all the same, if Landlock says what. Without
    Landlock it stays root's.
    """
    if os.geteuid() != 0:
        return {Layer.UNPRIVILEGED_USER}
    reads_all = not needs.open_to_others
    if reads_all and Layer.LANDLOCK_FILES not in layers:
        return set()
    if reads_all:
        kernel.prctl(kernel.PR_SET_KEEPCAPS, 1)
    own = FIRST_USER + os.getpid()
    try:
        _change_user(own, needs)
    except OSError:
        _change_user(NOBODY, needs)
    if os.geteuid() == own:
        _lower(resource.RLIMIT_NPROC, needs.threads)
    if reads_all:
        kernel.keep_capabilities(kernel.CAP_DAC_READ_SEARCH)
    return {Layer.UNPRIVILEGED_USER}


def _change_user(user: int, needs: Needs) -> None:
    if needs.folder is not None:
        for path in (needs.folder, *needs.folder.iterdir()):
            os.chown(path, user, user, follow_symlinks=False)
    os.setgroups([])
    os.setresgid(user, user, user)
    os.setresuid(user, user, user)
