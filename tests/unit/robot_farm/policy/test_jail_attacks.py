"""From inside a real policy process: whatever an attacking inference tries is denied or ended within twice its deadline."""

import os
import platform
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

from api_schemas.trial import FAULT_OF, Fault, OutcomeKind
from jail.detection import detect
from jail.level import JailLevel
from robot_farm.policy import jail
from robot_farm.policy.jail import ACTION_CPU_S, ACTION_WALL_S, JailedPolicy, PolicyFailedError
from tests.graphs import linear
from tests.processes import lives
from tests.stalls import stalls
from tests.unit.robot_farm.policy.attacking_policy import ATTACKS, LINK_ATTACKS, SYSTEM_CALLS, WHICHEVER

ATTACKER = "tests.unit.robot_farm.policy.attacking_policy"
OBSERVATION = np.linspace(-1, 1, 54, dtype=np.float32)
ALLOWED = {"one thread"}
ENDED = {"spin for ever"}
STAYING = {"200 threads"}
"""Whatever is denied of them leaves something behind in the process."""


@pytest.fixture(scope="module", autouse=True)
def whole_jail():
    jail = detect()
    if jail.level is not JailLevel.FULL:
        reason = f"this machine's jail is {jail}: the attacks need Landlock, a filter of system calls and x86-64 or 64-bit ARM"
        print(reason)
        pytest.skip(reason)
    return jail


HARMLESS = (
    "read /etc/passwd",
    "list /",
    "internet socket",
    "unix socket",
    "netlink socket",
    "spawn",
    "executable memory",
    "fork",
)


def test_the_same_attacks_succeed_outside():
    """So that a denial is the jail's doing. The fork comes last: what follows it would be done twice."""
    said = f"from tests.unit.robot_farm.policy.attacking_policy import attack\nfor name in {HARMLESS!r}: attack(name)"
    subprocess.run([sys.executable, "-c", said], check=True, timeout=120)


@pytest.fixture
def attacker(tmp_path):
    """A jailed process that has got as far as its first action, and whose action is the named attack."""
    opened = []

    def start(name: str) -> JailedPolicy:
        graph = tmp_path / "attack"
        graph.write_text(name)
        policy = JailedPolicy(name, graph, least=JailLevel.FULL, module=ATTACKER)
        opened.append(policy)
        policy.reset()
        return policy

    yield start
    for policy in opened:
        policy.close()


@pytest.fixture(scope="module")
def inside(tmp_path_factory, whole_jail):
    """A jailed process for all attacks that leave nothing behind where they are denied, and its graph; another if one ended."""
    graph, opened = tmp_path_factory.mktemp("inside") / "attack", []
    graph.write_text(WHICHEVER)

    def living():
        if not opened or not lives(opened[-1].pid):
            opened.append(JailedPolicy("inside", graph, least=JailLevel.FULL, module=ATTACKER))
            opened[-1].reset()
        return opened[-1], graph

    yield living
    for policy in opened:
        policy.close()


def asks_for(name):
    observation = OBSERVATION.copy()
    observation[0] = sorted(ATTACKS).index(name)
    return observation


@pytest.mark.parametrize("name", sorted(ATTACKS.keys() - ALLOWED - ENDED))
def test_what_is_forbidden_is_denied(name, attacker, inside, tmp_path):
    policy, graph = (attacker(name), tmp_path / "attack") if name in STAYING else inside()
    with pytest.raises(PolicyFailedError) as caught:
        policy.act(OBSERVATION if name in STAYING else asks_for(name))
    assert caught.value.kind is OutcomeKind.POLICY_ERROR
    assert FAULT_OF[caught.value.kind] is Fault.POLICY
    assert any(word in str(caught.value) for word in ("PermissionError", "MemoryError", "OSError", "RuntimeError")), caught.value
    assert graph.exists()
    for trace in ("/tmp/trifarm-attack", "/dev/shm/trifarm-attack", "/tmp/trifarm-attack-folder", "/trifarm-attack"):
        assert not Path(trace).exists()


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the numbers of system calls here are those of x86-64")
def test_system_calls_nobody_needs_are_refused_by_number(attacker):
    with pytest.raises(PolicyFailedError, match=f"PermissionError: all {len(SYSTEM_CALLS)} were denied"):
        attacker("system calls").act(OBSERVATION)


@pytest.mark.parametrize("name", LINK_ATTACKS)
def test_nothing_that_comes_through_the_pipe_stops_or_breaks_the_robot(name, attacker):
    policy, started_s = attacker(name), time.monotonic()
    with stalls() as stalled, pytest.raises(PolicyFailedError) as caught:
        for _ in range(2000):
            policy.act(OBSERVATION)
    assert FAULT_OF[caught.value.kind] is Fault.POLICY
    assert time.monotonic() - started_s < 2 * ACTION_WALL_S + stalled.seconds


def test_an_error_text_steers_no_terminal(tmp_path):
    said = jail._text(b"name \x1b]0;title\x07 \xff\n end")
    assert all(each.isprintable() for each in said)
    assert "end" in said


def test_no_jailed_process_reaches_another_of_the_same_farm(attacker, tmp_path):
    """Not even through /proc, or where both have one user because the farm is not root's."""
    with JailedPolicy("victim", linear(tmp_path / "p.onnx")) as victim:
        victim.reset()
        paths = [f"/proc/{victim.pid}/{what}" for what in ("mem", "environ", "fd", "status")]
        with pytest.raises(PolicyFailedError, match="all 4 were denied"):
            attacker(f"open {' '.join(paths)}").act(OBSERVATION)
        assert victim.act(OBSERVATION)[0].shape == (9,)


def test_a_thread_may_be_started(attacker):
    action, _ = attacker("one thread").act(OBSERVATION)
    assert action.shape == (9,)


def test_spinning_ends_within_twice_the_deadline(attacker, monkeypatch):
    monkeypatch.setattr(jail, "ACTION_WALL_S", 240.0)  # a machine may stall: then it is the platform's fault
    policy = attacker("spin for ever")
    pid, started_s = policy.pid, time.monotonic()
    before_s = time.clock_gettime(~pid << 3 | 2)  # of its start
    with pytest.raises(PolicyFailedError, match="CPU time") as caught:
        policy.act(OBSERVATION)
    used_s = time.clock_gettime(~pid << 3 | 2) - before_s
    policy.close()
    print(f"ended after {used_s:.2f} s of CPU time, {time.monotonic() - started_s:.2f} s of wall time")
    assert caught.value.kind is OutcomeKind.ACTION_DEADLINE
    assert used_s < 2 * ACTION_CPU_S
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_many_quick_actions_come_to_the_trials_deadline(tmp_path, monkeypatch):
    monkeypatch.setattr("robot_farm.policy.jail.TRIAL_CPU_S", 0.05)
    with JailedPolicy("quick", linear(tmp_path / "p.onnx")) as policy:
        policy.reset()
        with pytest.raises(PolicyFailedError, match="actions of one trial") as caught:
            for _ in range(200_000):
                policy.act(OBSERVATION)
        assert caught.value.kind is OutcomeKind.ACTION_DEADLINE


def test_it_ends_when_its_robot_is_killed(tmp_path):
    """Also after its change of user, which makes the kernel forget the wish to die with the parent."""
    graph = tmp_path / "attack"
    graph.write_text("spin for ever")
    robot = subprocess.Popen([sys.executable, "-c", _ROBOT, str(graph)], stdout=subprocess.PIPE, text=True)
    assert robot.stdout is not None
    with robot.stdout:
        pid = int(robot.stdout.readline())
    time.sleep(0.2)
    robot.kill()
    robot.wait()
    until_s = time.monotonic() + 120
    while _runs(pid) and time.monotonic() < until_s:
        time.sleep(0.02)
    assert not _runs(pid)


_ROBOT = textwrap.dedent(f"""
    import pathlib, sys
    import numpy as np
    from robot_farm.policy.jail import JailedPolicy
    policy = JailedPolicy("spin", pathlib.Path(sys.argv[1]), module="{ATTACKER}")
    policy.reset()
    print(policy.pid, flush=True)
    policy.act(np.zeros(54, np.float32))
""")


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def test_each_process_of_a_farm_of_root_has_a_user_of_its_own(tmp_path):
    if os.geteuid() != 0:
        print("not root: policies run as the farm's own user")
        pytest.skip("not root: policies run as the farm's own user")
    graph = linear(tmp_path / "p.onnx")
    with JailedPolicy("a", graph) as one, JailedPolicy("b", graph) as other:
        users = set()
        for policy in (one, other):
            policy.reset()
            status = Path(f"/proc/{policy.pid}/status").read_text()
            users |= {line for line in status.splitlines() if line.startswith("Uid:")}
            assert "CapEff:\t0000000000000000" in status
            assert "CapPrm:\t0000000000000000" in status
            assert "Threads:\t1\n" in status
        assert len(users) == 2
        assert not any("\t0" in user for user in users)


def test_a_policy_acts_the_same_in_jail_and_outside(tmp_path):
    import onnxruntime

    graph = linear(tmp_path / "p.onnx")
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(3)
    with JailedPolicy("same", graph, least=JailLevel.FULL) as policy:
        policy.reset()
        for _ in range(200):
            observation = rng.normal(size=54).astype(np.float32)
            expected = session.run(None, {"observation": observation[None]})[0][0]
            np.testing.assert_array_equal(policy.act(observation)[0], expected.astype(np.float64))
