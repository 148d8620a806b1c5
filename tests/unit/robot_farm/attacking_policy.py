"""A policy process whose inference attacks: ``python -m tests.unit.robot_farm.attacking_policy GRAPH IN_FD OUT_FD ROBOT_PID``.

The file in the place of a graph names the attack. It has everything that code inside a real policy process would have, which is
more than any network can do. An attack that succeeds answers with an action; one that is denied raises an error.
"""

import ctypes
import mmap
import os
import resource
import signal
import socket
import sys
import threading
import time
from pathlib import Path

import robot_farm.jailed_policy
from api_schemas.jail import kernel

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
}
"""On x86-64."""


def attack(name: str) -> None:
    """Carries out the named attack; returns if it succeeded."""
    if name.startswith("call "):
        kernel.system_call(SYSTEM_CALLS[name.removeprefix("call ")], 0, 0, 0, 0)
        return
    ATTACKS[name]()


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
    "read its own source": lambda: Path(robot_farm.jailed_policy.__file__).read_text(),
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


def _load(graph: bytes, np, _onnxruntime) -> robot_farm.jailed_policy.Act:
    name = graph.decode()

    def act(_data: bytes):
        attack(name)
        return np.zeros(9, np.float32), 0

    return act


if __name__ == "__main__":
    sys.exit(robot_farm.jailed_policy.main(_load))
