"""The policy process: runs one ONNX graph on the observations that the robot sends, and nothing else.

Started as ``python -m robot_farm.policy.jailed_policy GRAPH.onnx IN_FD OUT_FD ROBOT_PID`` by ``jail.py``, for a policy that sees
with the descriptor of its images and their shape after that; imports as little as it can.
It loads the runtime, opens the graph and the images, closes the jail, and only then looks at what a stranger made.
"""

import mmap
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from api_schemas import policy_graph, policy_link
from api_schemas.builtin_mark import BUILTIN_MARK
from api_schemas.policy_graph import GraphRunner
from jail.entering import end_with_parent, enter
from jail.needs import Needs

NEEDS = Needs(memory_bytes=4 * 1024**3)
"""No file, no folder: the graph is read before."""

MOST_NAMED_BYTES = 100
Act = Callable[[bytes], tuple[Any, int]]
"""From an observation's bytes to an action (float32 array) and its inference time in ns.

One that remembers can ``forget``, and gives ``another`` of its kind for a trial beside its own.
"""


class UnknownHereError(Exception):
    """The robot's version is not made for this policy, which is no fault of the policy."""


def main(load: Callable[..., Act] | None = None) -> int:
    """Answer requests until the robot closes its end. ``load`` makes something else of the graph than a network: tests only."""
    graph, read_fd, write_fd, robot_pid = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    end_with_parent(robot_pid)
    try:
        import numpy as np

        onnxruntime = policy_graph.runtime()
        content = graph.read_bytes()
        images = _images(sys.argv[5:], np)
        jail = enter(NEEDS)
    except Exception as error:  # the robot's installation is broken, which is no fault of the policy
        _reply_text(write_fd, error, policy_link.BROKEN)
        return 1
    os.write(write_fd, policy_link.pack_reply(policy_link.JAILED, " ".join(jail.layers).encode()))
    try:
        act = (load or _load)(content, np, onnxruntime)
        if images is not None and isinstance(act, Network):
            act = act.seeing(images)
    except UnknownHereError as error:
        _reply_text(write_fd, error, policy_link.BROKEN)
        return 1
    except Exception as error:  # whatever the runtime raises goes to the robot as text
        _reply_text(write_fd, error)
        return 1
    os.write(write_fd, policy_link.pack_reply(policy_link.READY))
    acts = [act]
    try:
        while True:
            acts = _answer(acts, read_fd, write_fd)
    except (policy_link.LinkClosedError, BrokenPipeError):
        return 0


class Network:
    """One policy in a session of one thread, with what it remembers of a trial."""

    def __init__(self, runner: GraphRunner, np: Any, images: Any = None) -> None:
        self._runner = runner
        self._np = np
        self._images = images

    def seeing(self, images: Any) -> "Network":
        """The same network with what it sees: an array that the robot writes."""
        return Network(self._runner, self._np, images)

    def __call__(self, data: bytes) -> tuple[Any, int]:
        """From an observation's bytes to an action (float32 array) and its inference time in ns."""
        observation = self._np.frombuffer(data, self._np.float32)[None]
        started_ns = time.perf_counter_ns()
        action = self._runner.act(observation, self._images)
        return action.reshape(-1), time.perf_counter_ns() - started_ns

    def forget(self) -> None:
        """Begin a new trial."""
        self._runner.forget()

    def another(self) -> "Network":
        """The same network for another trial, with a memory of its own."""
        return Network(self._runner.another(), self._np, self._images)


def _images(given: list[str], np: Any) -> Any:
    """The array that the robot writes images into, from its descriptor and shape; None for a policy that does not see."""
    if not given:
        return None
    fd, shape = int(given[0]), tuple(map(int, given[1:]))
    memory = mmap.mmap(fd, 0, mmap.MAP_SHARED, mmap.PROT_READ)
    os.close(fd)
    return np.frombuffer(memory, np.uint8).reshape(shape)


def _load(graph: bytes, np, _onnxruntime) -> Network:
    """The network as a function from observation bytes to an action array and its inference time in ns."""
    if graph.startswith(BUILTIN_MARK):
        asked = graph[:MOST_NAMED_BYTES].decode(errors="replace").strip()
        raise UnknownHereError(f"this robot is too old for it: it does not know the {asked}; update the robot")
    return Network(GraphRunner(policy_graph.session(graph)), np)


def _answer(acts: list[Act], read_fd: int, write_fd: int) -> list[Act]:
    """Answer one request: actions that may depend on all observations since the last reset, or a reset.

    Gives one ``act`` for each trial that is under way.
    """
    kind, data = policy_link.read_request(read_fd)
    try:
        if kind == policy_link.RESET:
            acts = _begun(acts, data)
            os.write(write_fd, policy_link.pack_reply(policy_link.OK))
            return acts
        if len(acts) == 1:
            action, inference_time_ns = acts[0](data)
            payload = action.tobytes()
        else:
            payload, inference_time_ns = _actions(acts, data)
    except Exception as error:
        _reply_text(write_fd, error)
        return acts
    os.write(write_fd, policy_link.pack_reply(policy_link.OK, payload, inference_time_ns))
    return acts


def _begun(acts: list[Act], data: bytes) -> list[Act]:
    """As many as trials begin: one unless the request says how many."""
    trials = policy_link.trials_of(data)
    if trials > len(acts):
        another = getattr(acts[0], "another", None)
        assert another is not None, "what is made of the graph gives others of its kind"
        acts = [*acts, *(another() for _ in range(len(acts), trials))]
    acts = acts[:trials]
    for act in acts:
        getattr(act, "forget", _nothing_to_forget)()
    return acts


def _actions(acts: list[Act], data: bytes) -> tuple[bytes, int]:
    """The actions of all trials, one after the other, and their inference time in ns."""
    size = len(data) // len(acts)
    found = [act(data[size * at : size * (at + 1)]) for at, act in enumerate(acts)]
    return b"".join(action.tobytes() for action, _ in found), sum(time_ns for _, time_ns in found)


def _nothing_to_forget() -> None:
    """What a plain function does when a new trial begins."""


def _reply_text(write_fd: int, error: Exception, status: int = policy_link.FAILED) -> None:
    text = f"{type(error).__name__}: {error}".encode(errors="replace")[: policy_link.MAX_TEXT_BYTES]
    os.write(write_fd, policy_link.pack_reply(status, text))


if __name__ == "__main__":
    sys.exit(main())
