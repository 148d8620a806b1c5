"""The filter of system calls: a list of those that a child may make; the kernel answers every other with an error.

Calls that are not on the list fail with EPERM: socket, fork, exec, kill, ptrace, mount, bpf, keyctl, userfaultfd, io_uring_setup,
unshare, memfd_create and all that nobody thought of. Calls that are newer than this file fail with ENOSYS, so that the C library
takes the older way. Unconditional entries are cached by the kernel (since 5.11), so that they cost nothing measurable.
"""

import ctypes
import errno
import os
import struct
from dataclasses import dataclass

from jail import kernel
from jail.system_calls import AUDIT_ARCH, number

_LOAD, _AND = 0x20, 0x54  # BPF_LD|W|ABS and BPF_ALU|AND|K
_EQUAL, _AT_LEAST, _RETURN = 0x15, 0x35, 0x06  # BPF_JMP|JEQ|K, BPF_JMP|JGE|K, BPF_RET|K
_ALLOW, _ERROR, _KILL = 0x7FFF0000, 0x00050000, 0x80000000
_AT_NUMBER, _AT_ARCH, _AT_ARGUMENTS = 0, 4, 16  # offsets in struct seccomp_data
_X32_BIT = 0x40000000
_NEWER_THAN_THIS_FILE = 463
"""The first number that no call of the table's time had (Linux 6.10); from here on numbers are the same on all machines."""
_CLONE_THREAD = 0x00010000
_PROT_EXEC = 4

# fmt: off
_ALWAYS = (
    "read", "write", "futex", "clock_gettime", "close", "lseek", "fstat", "munmap", "mremap", "brk", "madvise",
    "set_robust_list", "rseq", "sched_yield", "sched_getaffinity", "getcpu", "clock_getres", "clock_nanosleep",
    "nanosleep", "gettimeofday", "time", "times", "getrusage", "getpid", "gettid", "getppid", "getuid", "geteuid",
    "getgid", "getegid", "rt_sigprocmask", "rt_sigreturn", "sigaltstack", "exit", "exit_group", "restart_syscall",
    "getrandom", "poll", "ppoll", "select", "pselect6", "membarrier", "sysinfo", "getpriority", "uname", "readv", "writev",
)
"""What computing and answering over an open pipe takes."""
_WITH_FILES = (
    "pread64", "pwrite64", "open", "openat", "stat", "lstat", "newfstatat", "statx", "statfs", "fstatfs", "access",
    "faccessat", "faccessat2", "readlink", "readlinkat", "getdents64", "getcwd", "ftruncate", "fallocate", "fsync",
    "fdatasync", "unlink", "unlinkat", "rename", "renameat", "renameat2", "mkdir", "mkdirat", "rmdir", "dup", "dup2",
    "dup3", "pipe2", "umask", "flock", "fadvise64", "sendfile", "copy_file_range", "utimensat", "setitimer",
    "getitimer", "rt_sigaction", "chdir", "fchmod",
)
"""What opening files takes; which files, Landlock says."""
# fmt: on
_FCNTL_COMMANDS = (0, 1, 2, 3, 4, 5, 6, 7, 1030)
"""Duplicates, flags and locks; not the owner of a file's signals, who could be anybody."""


@dataclass(frozen=True)
class _Argument:
    """A call is allowed if half of one of its arguments, masked, is one of these values."""

    name: str
    index: int
    values: tuple[int, ...]
    mask: int = 0xFFFFFFFF
    and_high: bool = False
    """Whether the other half must be 0: for pointers. Both machines are little-endian, so that it is the second one."""


def restrict(on: str, *, files: bool, executable_memory: bool) -> None:
    """Lets this process make none but the listed calls from now on. Needs no-new-privileges.

    Args:
        on: the machine, as in ``AUDIT_ARCH``.
        files: whether it may open files.
        executable_memory: whether it may make memory executable, as compilers and the loading of libraries do.

    Raises:
        OSError: the kernel has no filters.
    """
    install(program(on, os.getpid(), files=files, executable_memory=executable_memory))


def install(code: bytes) -> None:
    """Has the kernel ask this program about every system call of this process from now on.

    Raises:
        OSError: the kernel has no filters, or the program is not one.
    """
    instructions = ctypes.create_string_buffer(code, len(code))
    # struct sock_fprog: a count and, at the width of a pointer, an address
    head = ctypes.create_string_buffer(struct.pack("HxxxxxxQ", len(code) // 8, ctypes.addressof(instructions)))
    kernel.prctl(kernel.PR_SET_SECCOMP, kernel.SECCOMP_MODE_FILTER, ctypes.c_void_p(ctypes.addressof(head)))


def program(on: str, pid: int, *, files: bool, executable_memory: bool) -> bytes:
    """The filter as classic BPF, 8 bytes an instruction."""
    found = [
        instruction(_LOAD, _AT_ARCH),
        instruction(_EQUAL, AUDIT_ARCH[on], 1, 0),
        instruction(_RETURN, _KILL),
        instruction(_LOAD, _AT_NUMBER),
    ]
    allowed = _ALWAYS + (_WITH_FILES if files else ()) + (("mmap", "mprotect") if executable_memory else ())
    for name in allowed:
        if (call := number(name, on)) is not None:
            found += [instruction(_EQUAL, call, 0, 1), instruction(_RETURN, _ALLOW)]
    for rule in _rules(on, pid, files=files, executable_memory=executable_memory):
        found += _conditional(rule, on)
    # Its flags lie in memory, which a filter cannot read: with ENOSYS the C library takes clone, whose flags it can.
    found += [instruction(_EQUAL, number("clone3", on) or 0, 0, 1), instruction(_RETURN, _ERROR | errno.ENOSYS)]
    found += [
        instruction(_AT_LEAST, _X32_BIT, 1, 0),
        instruction(_AT_LEAST, _NEWER_THAN_THIS_FILE, 1, 0),
        instruction(_RETURN, _ERROR | errno.EPERM),
        instruction(_RETURN, _ERROR | errno.ENOSYS),
    ]
    return b"".join(found)


def _rules(on: str, pid: int, *, files: bool, executable_memory: bool) -> list[_Argument]:
    rules = [
        _Argument("clone", 0, (_CLONE_THREAD,), _CLONE_THREAD),  # threads, but no processes
        _Argument("tgkill", 0, (pid,)),  # how a program aborts itself
        _Argument("prlimit64", 2, (0,), and_high=True),  # to look at limits, not to set them
    ]
    if not executable_memory:
        rules += [_Argument("mmap", 2, (0,), _PROT_EXEC), _Argument("mprotect", 2, (0,), _PROT_EXEC)]
    if files:
        rules.append(_Argument("fcntl", 1, _FCNTL_COMMANDS))
    return [rule for rule in rules if number(rule.name, on) is not None]


def _conditional(rule: _Argument, on: str) -> list[bytes]:
    """Jumps over the whole block if it is another call; else it ends here."""
    tests = [each for value in rule.values for each in (instruction(_EQUAL, value, 0, 1), instruction(_RETURN, _ALLOW))]
    at, refuse = _AT_ARGUMENTS + 8 * rule.index, instruction(_RETURN, _ERROR | errno.EPERM)
    high = [instruction(_LOAD, at + 4), instruction(_EQUAL, 0, 1, 0), refuse] if rule.and_high else []
    block = [*high, instruction(_LOAD, at), instruction(_AND, rule.mask), *tests, refuse]
    return [instruction(_EQUAL, number(rule.name, on) or 0, 0, len(block)), *block]


def instruction(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
    """One instruction of classic BPF; jumps count the instructions that are left out."""
    return struct.pack("<HBBI", code, if_true, if_false, value)
