"""A policy process: its answers, its faults, and that it keeps nothing from one trial to the next."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from api_schemas.policy_images import PolicyImages
from api_schemas.trial import FAULT_OF, Fault, OutcomeKind
from robot_farm.policy.jail import JailedPolicy, PolicyFailedError
from tests.graphs import endless, linear, memory_hog, seeing

OBSERVATION = np.linspace(-1, 1, 54, dtype=np.float32)


def test_same_observation_same_bits_first_and_tenth_time(tmp_path):
    graph = linear(tmp_path / "policy.onnx")
    with JailedPolicy("a", graph) as kept, JailedPolicy("a", graph) as fresh:
        answers = []
        for _ in range(10):
            kept.reset()
            answers.append(np.stack([kept.act(OBSERVATION * k)[0] for k in range(20)]))
        fresh.reset()
        alone = np.stack([fresh.act(OBSERVATION * k)[0] for k in range(20)])
    for answer in answers:
        np.testing.assert_array_equal(answer, alone)


def test_a_policy_sees_what_the_robot_shows_and_can_only_read_it(tmp_path):
    images = np.zeros((3, 270, 270, 3), np.uint8)
    with JailedPolicy("sees", seeing(tmp_path / "p.onnx"), images=PolicyImages()) as policy:
        policy.reset()
        dark, _ = policy.act(np.zeros(44, np.float32))
        images[2, ..., 0] = 255
        policy.show(images)
        bright, _ = policy.act(np.zeros(44, np.float32))
        maps = Path(f"/proc/{policy.pid}/maps").read_text().splitlines()
        kinds = {line.split()[1] for line in maps if "memfd:images" in line}
    np.testing.assert_allclose(dark, 0.0, atol=1e-6)
    np.testing.assert_allclose(bright, [0] * 6 + [0.3, 0, 0], atol=1e-6)
    assert kinds == {"r--s"}


def test_a_network_that_sees_has_the_time_of_any_other(tmp_path, monkeypatch):
    monkeypatch.setattr("robot_farm.policy.jail.TRIAL_CPU_S", 0.0)
    with JailedPolicy("sees", seeing(tmp_path / "p.onnx"), images=PolicyImages()) as policy:
        policy.reset()
        with pytest.raises(PolicyFailedError, match="actions of one trial took more than") as caught:
            for _ in range(200):
                policy.act(np.zeros(44, np.float32))
    assert caught.value.kind is OutcomeKind.ACTION_DEADLINE


def expect_failure(graph, kind: OutcomeKind, words: str) -> None:
    with JailedPolicy("bad", graph) as policy:
        with pytest.raises(PolicyFailedError, match=words) as caught:
            policy.reset()
            policy.act(OBSERVATION)
        assert caught.value.kind is kind
        assert FAULT_OF[kind] is Fault.POLICY


def test_nan_is_the_policys_fault(tmp_path):
    expect_failure(linear(tmp_path / "p.onnx", bias=float("nan")), OutcomeKind.NONFINITE_ACTION, "not finite")


def test_endless_computation_is_ended_by_its_cpu_time(tmp_path, monkeypatch):
    monkeypatch.setattr("robot_farm.policy.jail.ACTION_WALL_S", 240.0)  # a machine may stall: then it is the platform's fault
    expect_failure(endless(tmp_path / "p.onnx"), OutcomeKind.ACTION_DEADLINE, "CPU time")


def test_too_much_memory_is_the_policys_fault(tmp_path):
    expect_failure(memory_hog(tmp_path / "p.onnx"), OutcomeKind.POLICY_ERROR, "network raised an error")


def test_broken_graph_is_the_policys_fault(tmp_path):
    broken = tmp_path / "p.onnx"
    broken.write_bytes(b"not a graph")
    expect_failure(broken, OutcomeKind.POLICY_ERROR, "could not be loaded")


def test_a_process_that_dies_is_named(tmp_path):
    with JailedPolicy("dies", linear(tmp_path / "p.onnx")) as policy:
        policy.reset()
        os.kill(policy.pid, signal.SIGKILL)
        with pytest.raises(PolicyFailedError, match="killed by signal 9") as caught:
            policy.act(OBSERVATION)
        assert caught.value.kind is OutcomeKind.POLICY_PROCESS_ENDED


def test_waiting_without_cpu_time_is_the_platforms_fault(tmp_path, monkeypatch):
    monkeypatch.setattr("robot_farm.policy.jail.ACTION_WALL_S", 0.3)
    with JailedPolicy("stopped", linear(tmp_path / "p.onnx")) as policy:
        policy.reset()
        os.kill(policy.pid, signal.SIGSTOP)
        with pytest.raises(PolicyFailedError, match="wall time") as caught:
            policy.act(OBSERVATION)
        assert FAULT_OF[caught.value.kind] is Fault.PLATFORM


def test_no_process_is_left_behind(tmp_path):
    with JailedPolicy("a", linear(tmp_path / "p.onnx")) as policy:
        policy.reset()
        pid = policy.pid
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
