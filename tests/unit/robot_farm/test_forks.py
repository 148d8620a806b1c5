"""Robots are forks of one warm parent: each a process of its own, with nothing in it that another one should not know."""

import os
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest

from robot_farm.forks import Forks
from robot_farm.settings import TOKEN_VARIABLE
from tests.benchmarks.robots_of_a_host import memory_mb
from tests.processes import lives

WITHIN_S = 120.0
FARMS_TOKEN = f"farms-{uuid.uuid4().hex}"
ARGUMENTS = ["--api", "http://127.0.0.1:1", "--bus", "tcp/127.0.0.1:1", "--farm", "farm", "--physics", "nominal"]
HOLDER = """
import sys, time
from robot_farm.forks import Forks

with Forks(sys.argv[1:], print) as forks:
    robots = [forks.robot(f"robot-{number}", f"token-{number}") for number in range(2)]
    while any(robot.pid is None for robot in robots):
        forks.look()
        assert all(robot.returncode is None for robot in robots), "a robot could not be forked"
        time.sleep(0.01)
    print("pids", *(robot.pid for robot in robots), file=sys.stderr, flush=True)
    time.sleep(600)
"""
DRAW = """
import random, sys, uuid
import numpy as np
from robot_farm import process

def live(name, settings, ending):
    print(name, uuid.uuid4().hex, random.getrandbits(64), np.random.randint(1 << 62), flush=True)
    return 7

process.live = live
from robot_farm import warm_parent
sys.exit(warm_parent.main())
"""


class Host:
    """Owner of a warm parent and of what it forks."""

    def __init__(self, owner, said, arguments):
        self.owner, self.said, self.arguments = owner, said, arguments
        self.asked = []

    def robot(self, number):
        """A robot that has come to a process, with a token that has a number of its own."""
        self.asked.append(self.owner.robot(f"robot-{number}", own_token(number)))
        until(self.owner, lambda: self.asked[-1].pid is not None)
        return self.asked[-1]

    def warm_parent(self):
        (pid,) = [pid for pid in children_of(os.getpid()) if b"robot_farm.warm_parent" in proc(pid, "cmdline")]
        return pid

    def end(self):
        for each in self.asked:
            each.end(signal.SIGKILL)
        until(self.owner, lambda: all(each.returncode is not None for each in self.asked))


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """One host for all tests; robots and their warm parent end with it."""
    said, arguments = [], [*ARGUMENTS, "--data", str(tmp_path_factory.mktemp("data"))]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(TOKEN_VARIABLE, FARMS_TOKEN)
        with Forks(arguments, said.append) as owner:
            yield Host(owner, said, arguments)


@pytest.fixture
def host(warm):
    yield warm
    warm.end()


def own_token(number):
    return f"own-{number}-{FARMS_TOKEN[::-1]}"


def until(owner, happened, within_s=WITHIN_S):
    give_up_s = time.monotonic() + within_s
    while not happened():
        assert time.monotonic() < give_up_s
        owner.look()
        time.sleep(0.01)


def proc(pid, name):
    return Path(f"/proc/{pid}/{name}").read_bytes()


def children_of(pid):
    return [int(child) for child in proc(pid, f"task/{pid}/children").split()]


def command_line(pid):
    return proc(pid, "cmdline").replace(b"\0", b" ").decode()


def parent(pid):
    return int(proc(pid, "stat").decode().rpartition(")")[2].split()[1])


def holds(pid, secret):
    """Whether a process has some bytes anywhere in its memory."""
    with Path(f"/proc/{pid}/mem").open("rb", buffering=0) as memory:
        for line in Path(f"/proc/{pid}/maps").read_text().splitlines():
            span, access = line.split()[:2]
            if not access.startswith("rw"):
                continue
            begin, end = (int(number, 16) for number in span.split("-"))
            try:
                if secret in os.pread(memory.fileno(), end - begin, begin):
                    return True
            except OSError:
                continue  # a part that cannot be read, such as that of the kernel
    return False


def test_each_robot_is_found_by_its_name_and_is_our_own_child(host):
    for number, each in enumerate((host.robot(0), host.robot(1))):
        until(host.owner, lambda pid=each.pid: "--robot robot-" in command_line(pid))
        shown = " ".join(["-m robot_farm --robot", f"robot-{number}", *host.arguments])
        assert command_line(each.pid).rstrip().endswith(shown)
        assert parent(each.pid) == os.getpid()


@pytest.mark.skipif(os.getuid() != 0, reason="nobody but root may look into a robot")
def test_a_robots_memory_and_environment_have_its_own_token_and_no_other(host):
    first, second = host.robot(0), host.robot(1)
    until(host.owner, lambda: holds(second.pid, own_token(1).encode()))
    for stranger in (own_token(0), FARMS_TOKEN):
        assert not holds(second.pid, stranger.encode())
    assert holds(os.getpid(), FARMS_TOKEN.encode()), "whoever looks finds what is there"
    for pid in (first.pid, second.pid, host.warm_parent()):
        assert not any(token.encode() in proc(pid, "environ") for token in (FARMS_TOKEN, own_token(0), own_token(1)))
    assert not holds(host.warm_parent(), FARMS_TOKEN[::-1].encode())


def test_how_a_robot_ended_is_known(host):
    killed, asked = host.robot(0), host.robot(1)
    os.kill(killed.pid, signal.SIGKILL)
    until(host.owner, lambda: killed.returncode is not None)
    assert killed.returncode == -signal.SIGKILL
    assert asked.returncode is None
    asked.end(signal.SIGTERM)
    until(host.owner, lambda: asked.returncode is not None)
    assert asked.returncode in (0, -signal.SIGTERM), "it ends by itself as soon as it listens to signals"


def test_orphans_of_robots_leave_nothing_behind(host):
    others = set(children_of(os.getpid()))  # of other tests in this process, and the warm parent
    robot = host.robot(0)
    until(host.owner, lambda: "--robot robot-" in command_line(robot.pid))
    os.kill(robot.pid, signal.SIGKILL)
    until(host.owner, lambda: not set(children_of(os.getpid())) - others - {host.warm_parent()})


def test_robots_outlive_their_warm_parent_and_who_waits_for_it_gets_another_one(host):
    first, before = host.robot(0), host.warm_parent()
    os.kill(before, signal.SIGSTOP)
    waiting = host.owner.robot("robot-1", "token")
    os.kill(before, signal.SIGKILL)
    until(host.owner, lambda: host.said and waiting.returncode is not None)
    assert waiting.pid is None
    assert f"the warm parent (pid {before}) ended with signal 9" in host.said[0]
    second = host.robot(1)
    assert host.warm_parent() != before
    assert lives(first.pid) and first.returncode is None
    assert lives(second.pid) and second.returncode is None


@pytest.mark.skipif(os.getuid() != 0, reason="nobody but root may look into a robot")
def test_most_of_what_a_robot_needs_is_shared(host):
    _, second = host.robot(0), host.robot(1)
    until(host.owner, lambda: holds(second.pid, own_token(1).encode()))
    proportional_mb, own_mb = memory_mb(second.pid)
    assert own_mb < 0.6 * proportional_mb


@pytest.mark.parametrize("number", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.scale)])
def test_robots_end_with_the_process_that_asked_for_them(number, tmp_path):
    """`test_robots_end_with_the_process_that_asked_for_them` has the signal that nobody can answer without scale."""
    command = [sys.executable, "-c", HOLDER, *ARGUMENTS, "--data", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as holder:
        try:
            told = next((line for line in holder.stderr if line.startswith("pids ")), "")
            robots = [int(pid) for pid in told.split()[1:]]
            children = children_of(holder.pid)
            assert len(robots) == 2
            assert len(children) == 3
            assert all(map(lives, children))
        finally:
            holder.send_signal(number)
    give_up_s = time.monotonic() + WITHIN_S
    while any(map(lives, children)):
        assert time.monotonic() < give_up_s
        time.sleep(0.01)


def test_forks_draw_different_numbers(tmp_path, monkeypatch, capfd):
    spawn = os.posix_spawn
    monkeypatch.setattr(os, "posix_spawn", lambda path, command, env: spawn(path, [command[0], "-c", DRAW, *command[4:]], env))
    with Forks([*ARGUMENTS, "--data", str(tmp_path)], print) as owner:
        drawing = [owner.robot(f"robot-{number}", "token") for number in range(3)]
        until(owner, lambda: all(each.returncode is not None for each in drawing))
    assert {each.returncode for each in drawing} == {7}
    drawn = [line.split()[1:] for line in capfd.readouterr().out.splitlines() if line.startswith("robot-")]
    assert len(drawn) == 3
    assert all(len(set(kind)) == 3 for kind in zip(*drawn, strict=True)), drawn
