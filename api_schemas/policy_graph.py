"""How a converted graph is run: an observation in, an action out, and what it remembers of a trial goes from call to call.

A graph with memory has, beside ``observation`` and ``action``, an input for each state and an output that gives the next one,
named like the input with ``NEXT`` before it. A trial begins with zeros. A graph that sees has an input ``images``, uint8.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from api_schemas.policy_images import IMAGES
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
    """One policy in one trial; owner of the trial's memory. Several may share a session.

    A session of the runtime gets the arrays that it reads and fills once and for all: handing them over in each call costs as
    much as a small network.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        inputs = session.get_inputs()
        self.sees = any(each.name == IMAGES for each in inputs)
        states = [each for each in inputs if each.name not in (OBSERVATION, IMAGES)]
        self._blank = {each.name: np.zeros(each.shape, np.float32) for each in states}
        self._outputs = [ACTION, *(NEXT + name for name in self._blank)]
        self._memory = self._blank
        self._bound = _Bound.of(session)

    def forget(self) -> None:
        """Begin a new trial."""
        self._memory = self._blank
        if self._bound is not None:
            self._bound.forget()

    def another(self) -> "GraphRunner":
        """The same policy for another trial."""
        return GraphRunner(self._session)

    def act(self, observation: np.ndarray, images: np.ndarray | None = None) -> np.ndarray:
        """The action, shape (1, 9).

        Args:
            observation: float32, shape (1, n).
            images: for a graph that sees, uint8, of the shape that its manifest says.

        Raises:
            ValueError: it sees, and there is nothing to see.
        """
        if self._bound is not None and self._bound.takes(observation):
            return self._bound.act(observation)
        given = {OBSERVATION: observation, **self._memory}
        if self.sees:
            if images is None:
                raise ValueError("this policy sees images, which only the robots of a farm take")
            given[IMAGES] = images
        action, *states = self._session.run(self._outputs, given)
        self._memory = dict(zip(self._blank, states, strict=True))
        return np.asarray(action, np.float32)


class _Bound:
    """A session's inputs and outputs as arrays that stay where they are; owner of the trial's memory."""

    def __init__(self, session: Any, inputs: dict[str, np.ndarray], outputs: dict[str, np.ndarray]) -> None:
        self._run, self._binding = session.run_with_iobinding, session.io_binding()
        value = runtime().OrtValue.ortvalue_from_numpy
        for name, array in inputs.items():
            self._binding.bind_ortvalue_input(name, value(array))
        for name, array in outputs.items():
            self._binding.bind_ortvalue_output(name, value(array))
        self._observation, self._action = inputs[OBSERVATION], outputs[ACTION]
        self._states = [(array, outputs[NEXT + name]) for name, array in inputs.items() if name != OBSERVATION]

    @staticmethod
    def of(session: Any) -> "_Bound | None":
        """None of a session that is not the runtime's, or of a graph whose arrays have no size or type that is known before."""
        if not hasattr(session, "run_with_iobinding"):
            return None
        described = session.get_inputs(), session.get_outputs()
        if not all(each.type == "tensor(float)" and _has_size(each.shape) for side in described for each in side):
            return None
        inputs, outputs = ({each.name: np.zeros(each.shape, np.float32) for each in side} for side in described)
        if outputs.keys() != {ACTION, *(NEXT + name for name in inputs if name != OBSERVATION)} or OBSERVATION not in inputs:
            return None
        return _Bound(session, inputs, outputs)

    def takes(self, observation: np.ndarray) -> bool:
        """Whether it has the shape that the graph asks for; the session itself says what is wrong with another one."""
        return observation.shape == self._observation.shape

    def forget(self) -> None:
        """Begin a new trial."""
        for state, _ in self._states:
            state[:] = 0.0

    def act(self, observation: np.ndarray) -> np.ndarray:
        """See :meth:`GraphRunner.act`."""
        self._observation[:] = observation
        self._run(self._binding)
        for state, following in self._states:
            state[:] = following
        return self._action.copy()


def _has_size(shape: Sequence[object]) -> bool:
    return all(isinstance(extent, int) for extent in shape)
