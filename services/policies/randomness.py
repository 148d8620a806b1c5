"""Operators that would make a policy answer differently each time: a trial must be repeatable from its seed."""

from collections import Counter
from collections.abc import Iterable, Sequence

from onnx import GraphProto, NodeProto, numpy_helper

from services.policies.unfit import UnfitError

DRAWING = frozenset(
    {"RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike", "Multinomial", "Bernoulli"},
)
"""Operators whose result is drawn, also with a seed: the runtime's generator goes on from one call to the next."""
TRAINING_MODE_INPUT = 2
"""Where Dropout takes ``training_mode``, since opset 12; before, it never drops."""


def check_repeatable(graphs: Sequence[GraphProto]) -> None:
    """Raises when a node draws random numbers or works as in training.

    Args:
        graphs: the whole network: the graph and all that lie within its nodes.

    Raises:
        UnfitError: names the operator.
    """
    off = _names_of_false(graphs)
    for node in (node for graph in graphs for node in graph.node):
        if node.op_type in DRAWING:
            raise _unfit(f"operator {node.op_type} draws random numbers")
        if _trains(node, off):
            raise _unfit(f"operator {node.op_type} is in training mode")


def _trains(node: NodeProto, off: frozenset[str]) -> bool:
    if node.op_type == "Dropout":
        mode = node.input[TRAINING_MODE_INPUT] if len(node.input) > TRAINING_MODE_INPUT else ""
        return mode != "" and mode not in off
    if node.op_type == "BatchNormalization":
        # Before opset 14 more than one result is what tells training.
        return len(node.output) > 1 or any(each.name == "training_mode" and each.i != 0 for each in node.attribute)
    return False


def _names_of_false(graphs: Sequence[GraphProto]) -> frozenset[str]:
    """The names that can be nothing but a constant false, wherever they are used."""
    given = Counter(each.name for graph in graphs for each in graph.initializer)
    given.update(each.name for graph in graphs for each in graph.input)
    given.update(name for graph in graphs for node in graph.node for name in node.output)
    return frozenset(name for name, false in _constants(graphs) if false and given[name] == 1)


def _constants(graphs: Iterable[GraphProto]) -> Iterable[tuple[str, bool]]:
    for graph in graphs:
        tensors = [(each.name, each) for each in graph.initializer]
        nodes = (node for node in graph.node if node.op_type == "Constant" and node.output)
        tensors += [(node.output[0], each.t) for node in nodes for each in node.attribute if each.name == "value"]
        for name, tensor in tensors:
            # Larger ones are weights; reading them all would cost for nothing.
            if list(tensor.dims) in ([], [1]):
                yield name, not numpy_helper.to_array(tensor).any()


def _unfit(what: str) -> UnfitError:
    return UnfitError(f"{what}, so that a trial could not be repeated; export the deterministic mean action instead")
