"""The calls of the Linux kernel that the standard library has no function for."""

import ctypes
import os
import sys

PR_SET_PDEATHSIG = 1
PR_SET_KEEPCAPS = 8
PR_SET_NO_NEW_PRIVS = 38
PR_SET_SECCOMP = 22
SECCOMP_MODE_FILTER = 2
CLONE_NEWNET = 0x40000000
CAP_DAC_READ_SEARCH = 2
_CAPABILITY_VERSION = 0x20080522


def prctl(option: int, *arguments: "int | ctypes.c_void_p") -> None:
    """Sets a property of this process; prctl is the kernel's name for it.

    Raises:
        OSError: the kernel refuses.
    """
    _check(_libc().prctl(option, *_wide(arguments)), "prctl")


def system_call(number: int, *arguments: "int | ctypes.c_void_p") -> int:
    """Any system call by its number.

    Raises:
        OSError: the kernel refuses.
    """
    return _check(_libc().syscall(ctypes.c_long(number), *_wide(arguments)), f"system call {number}")


def unshare(flags: int) -> None:
    """Leaves what is shared with other processes.

    Raises:
        OSError: the kernel refuses.
    """
    _check(_libc().unshare(flags), "unshare")


def keep_capabilities(*kept: int) -> None:
    """Gives up all capabilities but these, which the process must have.

    Raises:
        OSError: the kernel refuses.
    """
    bits = sum(1 << each for each in kept if each < 32)
    head = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION, 0)
    # effective, permitted and inheritable, for the first 32 capabilities and for the others
    sets = (ctypes.c_uint32 * 6)(bits, bits, 0, 0, 0, 0)
    _check(_libc().capset(head, sets), "capset")


def _libc() -> ctypes.CDLL:
    if sys.platform != "linux":
        raise OSError(f"{sys.platform} is not Linux")
    return ctypes.CDLL(None, use_errno=True)


def _wide(arguments: "tuple[int | ctypes.c_void_p, ...]") -> "tuple[ctypes.c_ulong | ctypes.c_void_p, ...]":
    """Numbers in the kernel's width: ctypes would pass them as 32 bits and leave the rest to chance; missing ones as 0."""
    given = tuple(ctypes.c_ulong(each) if isinstance(each, int) else each for each in arguments)
    return given + (ctypes.c_ulong(0),) * (4 - len(given))


def _check(result: int, what: str) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")
    return result
