"""How a converted graph is run: an observation in, an action out, and what it remembers of a trial goes from call to call.

A graph with memory has, beside ``observation`` and ``action``, an input for each state and an output that gives the next one,
named like the input with ``NEXT`` before it. A trial begins with zeros.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from jail.environment import SILENT

OBSERVATION = "observation"
ACTION = "action"
NEXT = "next_"


def runtime() -> Any:
    """onnxruntime, silent, imported when it is first asked for: some processes close their jail right after.

    Every process of the farm gets it from here; a test looks for other imports.
    """
    os.environ.update(SILENT)
    import onnxruntime

    onnxruntime.disable_telemetry_events()
    return onnxruntime


def session(graph: bytes | Path) -> Any:
    """A session of one thread on the CPU, as robots have it; ``graph`` is a model or its file.

    Raises:
        Exception: the runtime cannot load the graph; of which class is the runtime's own affair.
    """
    module = runtime()
    options = module.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = module.ExecutionMode.ORT_SEQUENTIAL
    options.log_severity_level = 4
    return module.InferenceSession(graph, options, providers=["CPUExecutionProvider"])


class Session(Protocol):
    """What is needed of an onnxruntime session."""

    def get_inputs(self) -> Sequence[Any]:
        """Its inputs, each with a name and a shape."""
        ...

    def run(self, output_names: Sequence[str], input_feed: dict[str, Any]) -> Sequence[Any]:
        """The named outputs."""
        ...


class GraphRunner:
    """One policy in one trial; owner of the trial's memory. Several may share a session."""

    def __init__(self, session: Session) -> None:
        self._session = session
        states = [each for each in session.get_inputs() if each.name != OBSERVATION]
        self._blank = {each.name: np.zeros(each.shape, np.float32) for each in states}
        self._outputs = [ACTION, *(NEXT + name for name in self._blank)]
        self._memory = self._blank

    def forget(self) -> None:
        """Begin a new trial."""
        self._memory = self._blank

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The action for one observation, float32 of shape (1, n)."""
        action, *states = self._session.run(self._outputs, {OBSERVATION: observation, **self._memory})
        self._memory = dict(zip(self._blank, states, strict=True))
        return np.asarray(action, np.float32)
