"""A policy process whose inference attacks.

Started as ``python -m tests.unit.robot_farm.policy.attacking_policy GRAPH IN_FD OUT_FD ROBOT_PID``.
The file in the place of a graph names the attack. It has everything that code inside a real policy process would have, which is
more than any network can do. An attack that succeeds answers with an action; one that is denied raises an error.
"""

import ctypes
import errno
import functools
import mmap
import os
import resource
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import robot_farm.policy.jailed_policy
from api_schemas import policy_link
from jail import kernel

SYSTEM_CALLS = {
    "ptrace": 101,
    "mount": 165,
    "bpf": 321,
    "keyctl": 250,
    "userfaultfd": 323,
    "io_uring_setup": 425,
    "unshare": 272,
    "setns": 308,
    "memfd_create": 319,
    "process_vm_writev": 311,
    "pidfd_open": 434,
    "perf_event_open": 298,
    "sched_setaffinity": 203,
    "setsid": 112,
    "execveat": 322,
    "clone3": 435,
    "process_vm_readv": 310,
    "kcmp": 312,
    "pidfd_getfd": 438,
    "pidfd_send_signal": 424,
    "kill": 62,
    "tkill": 200,
    "rt_sigqueueinfo": 129,
    "shmget": 29,
    "msgget": 68,
    "semget": 64,
    "mq_open": 240,
    "memfd_secret": 447,
    "io_uring_enter": 426,
    "prctl": 157,
    "personality": 135,
    "modify_ldt": 154,
    "seccomp": 317,
    "timer_create": 222,
    "timerfd_create": 283,
    "setitimer": 38,
    "epoll_create1": 291,
    "inotify_init1": 294,
    "fanotify_init": 300,
    "name_to_handle_at": 303,
    "open_by_handle_at": 304,
    "sendmsg": 46,
    "recvmsg": 47,
    "ioctl": 16,
    "vmsplice": 278,
    "mlockall": 151,
    "setpriority": 141,
    "sched_setscheduler": 144,
    "chroot": 161,
    "pivot_root": 155,
    "add_key": 248,
    "init_module": 175,
    "kexec_load": 246,
    "capset": 126,
    "rt_sigaction": 13,
}
"""On x86-64."""


def attack(name: str) -> None:
    """Carries out the named attack; returns if it succeeded."""
    if name.startswith("open "):
        _all_denied({each: functools.partial(os.open, each, os.O_RDONLY) for each in name.split()[1:]})
    elif name == "system calls":
        _all_denied({each: functools.partial(kernel.system_call, number, 0, 0, 0, 0) for each, number in SYSTEM_CALLS.items()})
    else:
        (ATTACKS | LINK_ATTACKS)[name]()


def _all_denied(attempts: dict[str, Callable[[], object]]) -> None:
    """Raises PermissionError if each attempt is denied, and another error that names those that are not."""
    reached = []
    for name, attempt in attempts.items():
        try:
            attempt()
        except OSError as error:
            if error.errno in (errno.EPERM, errno.EACCES, errno.ENOSYS):
                continue
        reached.append(name)
    if reached:
        raise ValueError(f"the kernel looked at {', '.join(reached)}")
    raise PermissionError(f"all {len(attempts)} were denied")


def _thread() -> None:
    thread = threading.Thread(target=time.sleep, args=(0.001,))
    thread.start()
    thread.join()


def _many_threads() -> None:
    for _ in range(200):
        threading.Thread(target=time.sleep, args=(60,), daemon=True).start()


def _fork_bomb() -> None:
    while True:
        os.fork()


def _spin() -> None:
    while True:
        pass


def _executable_memory() -> None:
    mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)


def _touch_8_gb() -> None:
    memory = mmap.mmap(-1, 8 * 1024**3)
    for at in range(0, 8 * 1024**3, 4096):
        memory[at] = 1


def _inherited_files() -> None:
    """What is open besides the standard three and the two pipes."""
    opened = [fd for fd in range(3, 1024) if _is_open(fd)]
    if len(opened) <= 2:
        raise PermissionError(f"only {opened} are open")


def _is_open(fd: int) -> bool:
    try:
        os.fstat(fd)
    except OSError:
        return False
    return True


def _library() -> None:
    ctypes.CDLL("libutil.so.1")


def _environment() -> None:
    if not any(name.startswith(("TRIFARM", "HOME", "AWS")) for name in os.environ):
        raise PermissionError(f"only {sorted(os.environ)} are there")


ATTACKS = {
    "read /etc/passwd": lambda: Path("/etc/passwd").read_text(),
    "list /": lambda: next(Path("/").iterdir()),
    "read its own source": lambda: Path(robot_farm.policy.jailed_policy.__file__).read_text(),
    "read the robot's environment": lambda: Path(f"/proc/{os.getppid()}/environ").read_bytes(),
    "read the robot's memory": lambda: os.open(f"/proc/{os.getppid()}/mem", os.O_RDONLY),
    "write in /tmp": lambda: Path("/tmp/trifarm-attack").write_text("here"),
    "write in its working folder": lambda: Path("trifarm-attack").write_text("here"),
    "write in /dev/shm": lambda: Path("/dev/shm/trifarm-attack").write_text("here"),
    "make a folder": lambda: Path("/tmp/trifarm-attack-folder").mkdir(),
    "remove a file": lambda: Path(sys.argv[1]).unlink(),
    "internet socket": lambda: socket.socket(socket.AF_INET, socket.SOCK_STREAM),
    "unix socket": lambda: socket.socket(socket.AF_UNIX),
    "netlink socket": lambda: socket.socket(socket.AF_NETLINK, socket.SOCK_RAW),
    "socket pair": socket.socketpair,
    "fork": os.fork,
    "fork bomb": _fork_bomb,
    "exec": lambda: os.execv("/bin/true", ["true"]),
    "spawn": lambda: os.posix_spawn("/bin/true", ["true"], {}),
    "allocate 8 GB": lambda: bytearray(8 * 1024**3),
    "touch 8 GB": _touch_8_gb,
    "spin for ever": _spin,
    "kill the robot": lambda: os.kill(os.getppid(), signal.SIGKILL),
    "kill its group": lambda: os.killpg(os.getpgid(os.getppid()), signal.SIGKILL),
    "kill everybody": lambda: os.kill(-1, signal.SIGKILL),
    "become root": lambda: os.setresuid(0, 0, 0),
    "executable memory": _executable_memory,
    "inherited files": _inherited_files,
    "load a library": _library,
    "secrets of the environment": _environment,
    "raise its limits": lambda: resource.prlimit(0, resource.RLIMIT_CORE, (0, 0)),
    "priority": lambda: os.nice(1),
    "one thread": _thread,
    "200 threads": _many_threads,
}


def _descriptor_of_robot() -> int:
    """Where replies to the robot go in."""
    return int(sys.argv[3])


def _part_of_a_reply() -> None:
    os.write(_descriptor_of_robot(), b"half")
    time.sleep(3600)


def _answers_in_advance() -> None:
    """Many good replies at once; from then on it reads nothing more."""
    reply = policy_link.pack_reply(policy_link.OK, bytes(36))
    for _ in range(1000):
        os.write(_descriptor_of_robot(), reply)
    time.sleep(3600)


def _reply(payload: bytes, inference_time_ns: int = 0) -> None:
    os.write(_descriptor_of_robot(), policy_link.pack_reply(policy_link.OK, payload, inference_time_ns))
    time.sleep(3600)


LINK_ATTACKS = {
    "a part of a reply": _part_of_a_reply,
    "answers in advance": _answers_in_advance,
    "a part of a number": lambda: _reply(bytes(35)),
    "too many numbers": lambda: _reply(bytes(360)),
    "an inference of 500 years": lambda: _reply(bytes(36), 2**64 - 1),
    "a reply of 4 GB": lambda: os.write(_descriptor_of_robot(), policy_link.REPLY.pack(0, 2**32 - 1, 0)),
}
"""What a process can try with the one thing that it has: the pipes to its robot."""


WHICHEVER = "whichever"
"""In the place of a name: each observation begins with the place of its attack among the sorted names."""


def _load(graph: bytes, np, _onnxruntime) -> robot_farm.policy.jailed_policy.Act:
    name = graph.decode()

    def act(data: bytes):
        attack(sorted(ATTACKS)[int(np.frombuffer(data, np.float32)[0])] if name == WHICHEVER else name)
        return np.zeros(9, np.float32), 0

    return act


if __name__ == "__main__":
    sys.exit(robot_farm.policy.jailed_policy.main(_load))
