"""The policy process: runs one ONNX graph on the observations that the robot sends, and nothing else.

Started as ``python -m robot_farm.jailed_policy GRAPH.onnx IN_FD OUT_FD ROBOT_PID`` by ``jail.py``; imports as little as it can.
It loads the runtime, opens the graph, closes the jail, and only then looks at what a stranger made.
"""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from api_schemas import policy_link
from api_schemas.jail.entering import end_with_parent, enter
from api_schemas.jail.needs import Needs

NEEDS = Needs(memory_bytes=4 * 1024**3)
"""No file, no folder: the graph is read before."""

Act = Callable[[bytes], tuple[Any, int]]
"""From an observation's bytes to an action (float32 array) and its inference time in ns."""


def main(load: Callable[..., Act] | None = None) -> int:
    """Answer requests until the robot closes its end. ``load`` makes something else of the graph than a network: tests only."""
    graph, read_fd, write_fd, robot_pid = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    end_with_parent(robot_pid)
    try:
        import numpy as np
        import onnxruntime

        content = graph.read_bytes()
        jail = enter(NEEDS)
    except Exception as error:  # the robot's installation is broken, which is no fault of the policy
        _reply_text(write_fd, error, policy_link.BROKEN)
        return 1
    os.write(write_fd, policy_link.pack_reply(policy_link.JAILED, " ".join(jail.layers).encode()))
    try:
        act = (load or _load)(content, np, onnxruntime)
    except Exception as error:  # whatever the runtime raises goes to the robot as text
        _reply_text(write_fd, error)
        return 1
    os.write(write_fd, policy_link.pack_reply(policy_link.READY))
    try:
        while True:
            _answer(act, read_fd, write_fd)
    except (policy_link.LinkClosedError, BrokenPipeError):
        return 0


def _load(graph: bytes, np, onnxruntime) -> Act:
    """The network as a function from observation bytes to an action array and its inference time in ns."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.log_severity_level = 4
    session = onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    name = session.get_inputs()[0].name

    def act(data: bytes):
        observation = np.frombuffer(data, np.float32)[None]
        started_ns = time.perf_counter_ns()
        action = session.run(None, {name: observation})[0]
        return np.asarray(action, np.float32).reshape(-1), time.perf_counter_ns() - started_ns

    return act


def _answer(act, read_fd: int, write_fd: int) -> None:
    """Answer one request; a feed-forward network has no state, so that a reset needs no more than an acknowledgement."""
    kind, count = policy_link.REQUEST.unpack(policy_link.read_exactly(read_fd, policy_link.REQUEST.size))
    if kind == policy_link.RESET:
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
