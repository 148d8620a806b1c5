"""The policy process: runs one ONNX graph on the observations that the robot sends, and nothing else.

Started as ``python -m robot_farm.jailed_policy GRAPH.onnx IN_FD OUT_FD ROBOT_PID`` by ``jail.py``; imports as little as it can.
"""

import ctypes
import os
import resource
import signal
import sys
import time

from api_schemas import policy_link
from api_schemas.policy_graph import GraphRunner

PR_SET_PDEATHSIG = 1
MEMORY_BYTES = 4 * 1024**3
MAX_FILES = 64


def main() -> int:
    """Answer requests until the robot closes its end."""
    graph, read_fd, write_fd, robot_pid = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    _end_with_robot(robot_pid)
    _limit_self()
    try:
        import numpy as np
        import onnxruntime
    except Exception as error:  # the robot's installation is broken, which is no fault of the policy
        _reply_text(write_fd, error, policy_link.BROKEN)
        return 1
    try:
        act = _load(graph, np, onnxruntime)
    except Exception as error:  # whatever the runtime raises goes to the robot as text
        _reply_text(write_fd, error)
        return 1
    os.write(write_fd, policy_link.pack_reply(policy_link.READY))
    try:
        while True:
            _answer(act, read_fd, write_fd)
    except (policy_link.LinkClosedError, BrokenPipeError):
        return 0


def _end_with_robot(robot_pid: int) -> None:
    """Be killed when the robot ends, however it ends; a network that computes for ever would never notice otherwise."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != robot_pid:
        sys.exit(1)  # it ended before the line above


def _limit_self() -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_NOFILE, (MAX_FILES, MAX_FILES))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))


def _load(graph: str, np, onnxruntime):
    """The network as a function from observation bytes to an action array and its inference time in ns."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.log_severity_level = 4
    session = onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    return Network(GraphRunner(session), np)


class Network:
    """A graph with its memory of the present trial; called as the function that ``_load`` gives."""

    def __init__(self, runner: GraphRunner, np) -> None:
        self._runner, self._np = runner, np

    def forget(self) -> None:
        """Begin a new trial."""
        self._runner.forget()

    def __call__(self, data: bytes):
        """The action and its inference time in ns; it may depend on all observations since the last reset."""
        observation = self._np.frombuffer(data, self._np.float32)[None]
        started_ns = time.perf_counter_ns()
        action = self._runner.act(observation)
        return action.reshape(-1), time.perf_counter_ns() - started_ns


def _answer(act, read_fd: int, write_fd: int) -> None:
    """Answer one request: an action, or a reset, after which nothing is remembered of what was observed before."""
    kind, count = policy_link.REQUEST.unpack(policy_link.read_exactly(read_fd, policy_link.REQUEST.size))
    if kind == policy_link.RESET:
        if isinstance(act, Network):
            act.forget()
        os.write(write_fd, policy_link.pack_reply(policy_link.OK))
        return
    try:
        action, inference_time_ns = act(policy_link.read_exactly(read_fd, 4 * count))
    except policy_link.LinkClosedError:
        raise
    except Exception as error:
        _reply_text(write_fd, error)
        return
    os.write(write_fd, policy_link.pack_reply(policy_link.OK, action.tobytes(), inference_time_ns))


def _reply_text(write_fd: int, error: Exception, status: int = policy_link.FAILED) -> None:
    text = f"{type(error).__name__}: {error}".encode(errors="replace")[: policy_link.MAX_TEXT_BYTES]
    os.write(write_fd, policy_link.pack_reply(status, text))


if __name__ == "__main__":
    sys.exit(main())
