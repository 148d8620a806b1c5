"""An uploaded ONNX file: what is taken of it, and all that is refused."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import onnx
from onnx import AttributeProto, GraphProto, ModelProto, NodeProto, TensorProto, ValueInfoProto, compose, numpy_helper

from api_schemas.policy import PolicyManifest
from services.policies.memory import check_states
from services.policies.randomness import check_repeatable
from services.policies.unfit import UnfitError, not_finite, wrong_input, wrong_output

DEFAULT_DOMAINS = frozenset({"", "ai.onnx"})
OLDEST_OPSET = 7
"""The first in which the operators around the network broadcast as they do today."""
OLDEST_IR_VERSION = 4
"""The first in which constants need not be inputs too."""
NODE_LIMIT = 5_000
PREFIX = "network/"


@dataclass(frozen=True)
class Uploaded:
    """The inside of an accepted graph; every name in it begins with ``PREFIX``."""

    nodes: Sequence[NodeProto]
    constants: Sequence[TensorProto]
    given: str
    gives: str
    opset: int
    ir_version: int
    states: Sequence[tuple[str, str, tuple[int, ...]]] = ()
    """The input and the output of each state, and its shape."""
    sees: str | None = None
    """The input for images, if it has one."""


def parse(content: bytes, manifest: PolicyManifest) -> Uploaded:
    """Reads and checks an ONNX file; never opens another file.

    Raises:
        UnfitError: it is not ONNX, is more than a plain network, or its shapes do not fit the manifest.
    """
    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:
        raise UnfitError(f"the file cannot be read as ONNX: {error}") from error
    opset = _check_plain(model)
    check_states(model.graph, manifest)
    model.graph.ClearField("value_info")
    given, gives = _ends(model.graph, manifest)
    try:
        graph = compose.add_prefix_graph(model.graph, PREFIX)
    except Exception as error:
        raise UnfitError(f"the graph is not well formed: {error}") from error
    return Uploaded(
        list(graph.node),
        list(graph.initializer),
        PREFIX + given,
        PREFIX + gives,
        opset,
        max(model.ir_version, OLDEST_IR_VERSION),
        [(PREFIX + each.input, PREFIX + each.output, each.shape) for each in manifest.states],
        None if manifest.images is None else PREFIX + manifest.images.input,
    )


def _check_plain(model: ModelProto) -> int:
    domains = {each.domain for each in model.opset_import}
    if model.functions or domains - DEFAULT_DOMAINS:
        others = ", ".join(sorted(domains - DEFAULT_DOMAINS)) or "its own functions"
        raise UnfitError(f"only operators of ONNX's default domain are taken; the file brings {others}")
    opset = max((each.version for each in model.opset_import), default=0)
    if opset < OLDEST_OPSET:
        raise UnfitError(f"the file has opset {opset}; export it with {OLDEST_OPSET} or later")
    if model.graph.sparse_initializer:
        raise UnfitError("sparse tensors are not taken; store them dense")
    for count, node in enumerate(_nodes(model.graph)):
        if count >= NODE_LIMIT:
            raise UnfitError(f"the graph has more than {NODE_LIMIT} nodes")
        if node.domain not in DEFAULT_DOMAINS:
            raise UnfitError(f"operator {node.op_type} is of domain {node.domain!r}; only the default domain is taken")
    if any(tensor.external_data or tensor.data_location == TensorProto.EXTERNAL for tensor in _tensors(model.graph)):
        raise UnfitError("the file keeps tensors in other files", pack=True)
    check_repeatable(list(_graphs(model.graph)))
    for tensor in _tensors(model.graph):
        _check_numbers(tensor)
    return opset


def _check_numbers(tensor: TensorProto) -> None:
    """Infinity may be meant, as the bound of a clip or a mask; what is no number never is."""
    try:
        values = numpy_helper.to_array(tensor)
    except Exception as error:
        raise UnfitError(f"it does not fit its shape ({error})", part=_part(tensor), slug="weights-malformed") from error
    if values.dtype.kind == "f" and np.isnan(values).any():
        raise not_finite(_part(tensor))


def _part(tensor: TensorProto) -> str:
    return f"tensor {tensor.name!r:.100}"


def _graphs(graph: GraphProto) -> Iterator[GraphProto]:
    waiting = [graph]
    while waiting:
        yield (each := waiting.pop())
        for node in each.node:
            for attribute in node.attribute:
                waiting += [attribute.g] if attribute.type == AttributeProto.GRAPH else attribute.graphs


def _nodes(graph: GraphProto) -> Iterator[NodeProto]:
    for each in _graphs(graph):
        yield from each.node


def _tensors(graph: GraphProto) -> Iterator[TensorProto]:
    for each in _graphs(graph):
        yield from each.initializer
        for node in each.node:
            for attribute in node.attribute:
                yield from [attribute.t] if attribute.type == AttributeProto.TENSOR else attribute.tensors


def _ends(graph: GraphProto, manifest: PolicyManifest) -> tuple[str, str]:
    known = {each.name for each in graph.initializer} | {state.input for state in manifest.states}
    known |= _check_images(graph, manifest)
    inputs = [each for each in graph.input if each.name not in known]
    outputs = [each for each in graph.output if each.name not in {state.output for state in manifest.states}]
    if len(inputs) != 1 or len(outputs) != 1:
        raise UnfitError(
            f"the graph has {len(inputs)} inputs and {len(outputs)} outputs beside the manifest's states and images; "
            "it must have one of each",
            instead=_for_images(inputs),
        )
    given, gives = inputs[0], outputs[0]
    rows, columns = (shape := _shape(given))[:1], shape[1:]
    if len(columns) != 1 or rows[0] not in (1, None):
        raise UnfitError(f"the graph's input has shape {_words(shape)}; it must be [1, n] or [batch, n]")
    if columns[0] is not None and columns[0] != manifest.network_inputs:
        raise wrong_input(manifest, columns[0])
    if (out := _shape(gives)) and out[-1] not in (None, manifest.network_outputs):
        raise wrong_output(out[-1], manifest)
    for each in (given, gives):
        if each.type.tensor_type.elem_type != TensorProto.FLOAT:
            raise UnfitError(f"{each.name} must be float32")
    return given.name, gives.name


def _check_images(graph: GraphProto, manifest: PolicyManifest) -> set[str]:
    """The name of the input for images, if the manifest asks for any, once it is known that it takes them."""
    if manifest.images is None:
        return set()
    wanted, inputs = manifest.images, {each.name: each for each in graph.input}
    if wanted.input not in inputs:
        raise UnfitError(
            f"the manifest's images go to {wanted.input!r}, which is no input of the graph; it has {', '.join(inputs) or 'none'}",
            part="the network's images",
        )
    given = inputs[wanted.input]
    if given.type.tensor_type.elem_type != TensorProto.UINT8 or _shape(given) != list(wanted.shape):
        kind = TensorProto.DataType.Name(given.type.tensor_type.elem_type).lower()
        raise UnfitError(
            f"{wanted.input!r:.100} takes {kind} of shape {_words(_shape(given))}; the manifest's images are uint8 of shape "
            f"{_words(list(wanted.shape))}",
            part="the network's images",
            instead="export the network with an input of exactly that type and shape, or state another images.shape",
        )
    return {wanted.input}


def _for_images(inputs: Sequence[ValueInfoProto]) -> str:
    """What to do where one input is left over that may be for images."""
    seeing = [each.name for each in inputs if each.type.tensor_type.elem_type == TensorProto.UINT8]
    return f"a network that sees names its input in the manifest: images.input {seeing[0]!r:.100}" if seeing else ""


def _shape(value: ValueInfoProto) -> list[int | None]:
    dimensions = value.type.tensor_type.shape.dim
    return [each.dim_value if each.HasField("dim_value") else None for each in dimensions]


def _words(shape: list[int | None]) -> str:
    return "[" + ", ".join("any" if each is None else str(each) for each in shape) + "]"
