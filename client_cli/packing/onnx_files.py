"""ONNX graphs whose tensors lie in other files become one file; graphs that are one already need no packing."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
import onnx.numpy_helper

from api_schemas import policy_graph
from api_schemas.policy import PolicyManifest
from client_cli.packing.original import Stack, scaled_as_stated
from client_cli.packing.quiet import first_sentence, quiet
from client_cli.packing.recipe import Array
from client_cli.packing.whole import finished
from client_cli.terminal.errors import UsageProblem


def keeps_tensors_elsewhere(path: Path) -> bool:
    """Whether tensors of the graph lie in other files.

    Raises:
        UsageProblem: it is not ONNX.
    """
    try:
        model = onnx.load(path, load_external_data=False)
    except Exception as error:
        raise UsageProblem(f"{path.name} cannot be read as ONNX: {first_sentence(error)}") from error
    return any(tensor.data_location == onnx.TensorProto.EXTERNAL for tensor in _tensors(model.graph))


def _tensors(graph: onnx.GraphProto) -> Iterator[onnx.TensorProto]:
    """All tensors of a graph, those of its constants and branches too."""
    yield from graph.initializer
    for attribute in (each for node in graph.node for each in node.attribute):
        yield from (attribute.t, *attribute.tensors)
        for inner in (attribute.g, *attribute.graphs):
            yield from _tensors(inner)


def as_one_file(path: Path) -> bytes:
    """The graph with all tensors inside.

    Raises:
        UsageProblem: a file is missing beside it.
    """
    try:
        with quiet():
            return onnx.load(path).SerializeToString()
    except Exception as error:
        raise UsageProblem(
            f"the tensors of {path.name} lie in another file that cannot be read ({first_sentence(error)}): put it beside "
            f"{path.name} under the name that it was exported with"
        ) from error


def tensors_of(graph: bytes) -> dict[str, Array]:
    """The named tensors of a graph in one file."""
    return {each.name: onnx.numpy_helper.to_array(each) for each in onnx.load_model_from_string(graph).graph.initializer}


def names_used(graph: bytes) -> set[str]:
    """All names that a graph's nodes or outputs take."""
    model = onnx.load_model_from_string(graph)
    return _taken(model.graph) | {each.name for each in model.graph.output}


def _taken(graph: onnx.GraphProto) -> set[str]:
    found = {name for node in graph.node for name in node.input}
    for attribute in (each for node in graph.node for each in node.attribute):
        for inner in (attribute.g, *attribute.graphs):
            found |= _taken(inner) | {each.name for each in inner.output}
    return found


class GraphOriginal:
    """The graph as it was given, run by onnxruntime, between the scaling that the manifest states."""

    def __init__(self, path: Path, manifest: PolicyManifest) -> None:
        self._session = policy_graph.session(path)
        self._manifest, self._stack = manifest, Stack(manifest)
        states = {state.input for state in manifest.states}
        self._input = next(each.name for each in self._session.get_inputs() if each.name not in states)
        following = [state.output for state in manifest.states]
        self._outputs = [each.name for each in self._session.get_outputs() if each.name not in following] + following
        self.begin()

    def begin(self) -> None:
        """Begin a trial."""
        self._stack.begin()
        self._memory = {state.input: np.zeros(state.shape, np.float32) for state in self._manifest.states}

    def act(self, observation: Array) -> Array:
        """The action (9,), in N m or rad, for an observation (n,)."""
        row = self._stack(scaled_as_stated(observation, self._manifest.input_scaling)).astype(np.float32)
        action, *states = self._session.run(self._outputs, {self._input: row[None], **self._memory})
        self._memory = {state.input: value for state, value in zip(self._manifest.states, states, strict=True)}
        return finished(np.asarray(action, np.float64).ravel(), self._manifest)
