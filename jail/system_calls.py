"""Numbers of the system calls that a jailed child may make, on x86-64 and on 64-bit ARM; None where a machine has no such call.

From the kernel's arch/x86/entry/syscalls/syscall_64.tbl and include/uapi/asm-generic/unistd.h.
"""

import platform

AUDIT_ARCH = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
"""What the kernel calls each machine in a filter's data."""

_MACHINES = tuple(AUDIT_ARCH)
# fmt: off
_NUMBERS: dict[str, tuple[int | None, int | None]] = {
    "getpriority": (140, 141),
    "read": (0, 63), "write": (1, 64), "close": (3, 57), "lseek": (8, 62), "fstat": (5, 80), "mmap": (9, 222),
    "munmap": (11, 215), "mremap": (25, 216), "mprotect": (10, 226), "brk": (12, 214), "madvise": (28, 233),
    "futex": (202, 98), "set_robust_list": (273, 99), "rseq": (334, 293), "sched_yield": (24, 124),
    "sched_getaffinity": (204, 123), "getcpu": (309, 168), "clock_gettime": (228, 113), "clock_getres": (229, 114),
    "clock_nanosleep": (230, 115), "nanosleep": (35, 101), "gettimeofday": (96, 169), "time": (201, None),
    "times": (100, 153), "getrusage": (98, 165), "getpid": (39, 172), "gettid": (186, 178), "getppid": (110, 173),
    "getuid": (102, 174), "geteuid": (107, 175), "getgid": (104, 176), "getegid": (108, 177), "rt_sigprocmask": (14, 135),
    "rt_sigreturn": (15, 139), "rt_sigaction": (13, 134), "sigaltstack": (131, 132), "exit": (60, 93),
    "exit_group": (231, 94), "restart_syscall": (219, 128), "getrandom": (318, 278), "poll": (7, None), "ppoll": (271, 73),
    "select": (23, None), "pselect6": (270, 72), "membarrier": (324, 283), "sysinfo": (99, 179), "uname": (63, 160),
    "clone": (56, 220), "clone3": (435, 435), "tgkill": (234, 131), "readv": (19, 65), "writev": (20, 66),
    "pread64": (17, 67), "pwrite64": (18, 68), "open": (2, None), "openat": (257, 56), "stat": (4, None), "lstat": (6, None),
    "newfstatat": (262, None), "statx": (332, 291), "statfs": (137, 43), "fstatfs": (138, 44), "access": (21, None),
    "faccessat": (269, 48), "faccessat2": (439, 439), "readlink": (89, None), "readlinkat": (267, 78),
    "getdents64": (217, 61), "getcwd": (79, 17), "fcntl": (72, 25), "ftruncate": (77, 46), "fallocate": (285, 47),
    "fsync": (74, 82), "fdatasync": (75, 83), "unlink": (87, None), "unlinkat": (263, 35), "rename": (82, None),
    "renameat": (264, 38), "renameat2": (316, 276), "mkdir": (83, None), "mkdirat": (258, 34), "rmdir": (84, None),
    "dup": (32, 23), "dup2": (33, None), "dup3": (292, 24), "pipe2": (293, 59), "umask": (95, 166), "flock": (73, 32),
    "fadvise64": (221, 223), "sendfile": (40, 71), "copy_file_range": (326, 285), "utimensat": (280, 88),
    "setitimer": (38, 103), "getitimer": (36, 102), "prlimit64": (302, 261), "ioctl": (16, 29), "chdir": (80, 49),
    "fchmod": (91, 52),
}
# fmt: on


def machine() -> str | None:
    """This machine's name if its numbers are known."""
    return name if (name := platform.machine()) in AUDIT_ARCH else None


def number(name: str, on: str) -> int | None:
    """The number of a call on a machine, None where it has none.

    Raises:
        KeyError: the call or the machine is not in the table.
    """
    return _NUMBERS[name][_MACHINES.index(on)] if on in AUDIT_ARCH else None
