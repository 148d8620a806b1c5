"""Recurrent layers from safetensors, named as torch's ``nn.LSTM`` and ``nn.GRU`` name them, as ONNX nodes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from onnx import helper

from api_schemas.policy import PolicyManifest
from api_schemas.policy_network import MOST_STATE_NUMBERS, Cell
from services.policies.memory import STATE
from services.policies.scaling import Chain, Remembered
from services.policies.unfit import UnfitError

Array = np.ndarray
PARTS = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
NORM = ("recurrent_norm.weight", "recurrent_norm.bias")
NORM_EPSILON = 1e-5
"""Of torch's ``nn.LayerNorm``."""
GATES = {Cell.LSTM: (0, 3, 1, 2), Cell.GRU: (1, 0, 2)}
"""Where torch keeps the gates that ONNX wants in this order: input, output, forget, cell; update, reset, new."""


@dataclass(frozen=True)
class Recurrent:
    """Layers of cells, each with its four tensors in torch's order of gates; the norm after the last, if any."""

    cell: Cell
    layers: tuple[tuple[Array, Array, Array, Array], ...]
    norm: tuple[Array, Array] | None

    @property
    def size(self) -> int:
        """Numbers that a layer gives."""
        return self.layers[0][1].shape[1]


def names(tensors: Mapping[str, Array]) -> frozenset[str]:
    """The names that recurrent layers of this file must have, and those of the norm if it has one."""
    count = sum(name.startswith("recurrent.weight_hh_l") for name in tensors)
    wanted = {f"recurrent.{part}_l{index}" for index in range(max(count, 1)) for part in PARTS}
    return frozenset(wanted | (set(NORM) if NORM[0] in tensors else set()))


def read(tensors: Mapping[str, Array], manifest: PolicyManifest, inputs: int) -> Recurrent:
    """The recurrent layers, checked against each other; all of ``names`` must be in the file.

    Args:
        tensors: float32.
        manifest: names the cell.
        inputs: numbers that the first layer must take.

    Raises:
        UnfitError: a shape does not fit.
    """
    assert manifest.recurrent is not None, "asked only where there is memory"
    cell, gates = manifest.recurrent, len(GATES[manifest.recurrent])
    count = sum(name.startswith("recurrent.weight_hh_l") for name in tensors)
    layers = []
    for index in range(count):
        layer = tuple(tensors[f"recurrent.{part}_l{index}"] for part in PARTS)
        size = layer[1].shape[-1] if layer[1].ndim == 2 else 0
        wanted = [(gates * size, inputs), (gates * size, size), (gates * size,), (gates * size,)]
        if not 0 < size <= MOST_STATE_NUMBERS or [each.shape for each in layer] != wanted:
            raise UnfitError(
                f"recurrent layer {index} has shapes {', '.join(str(each.shape) for each in layer)}; a layer of "
                f"{size} {cell.value.upper()} cells that takes {inputs} numbers has {', '.join(map(str, wanted))}"
            )
        layers.append(layer)
        inputs = size
    if len({layer[1].shape for layer in layers}) != 1:
        raise UnfitError("all recurrent layers must have the same number of cells")
    norm = (tensors[NORM[0]], tensors[NORM[1]]) if NORM[0] in tensors else None
    if norm is not None and {each.shape for each in norm} != {(inputs,)}:
        raise UnfitError(f"recurrent_norm must have {inputs} weights and {inputs} biases")
    return Recurrent(cell, tuple(layers), norm)


def append(chain: Chain, recurrent: Recurrent) -> None:
    """Goes on with the layers: a row goes in, a row comes out, and the states are remembered."""
    size = recurrent.size
    row = chain.constant("recurrent_row", np.array([1, size]))
    for index, layer in enumerate(recurrent.layers):
        given = chain.constant(f"recurrent{index}_sequence", np.array([1, 1, layer[0].shape[1]]))
        sequence = chain.node("Reshape", [chain.at, given], f"recurrent{index}_in")
        weights = _constants(chain, recurrent.cell, layer, index)
        parts = ("h", "c") if recurrent.cell is Cell.LSTM else ("h",)
        states = [f"{STATE}{part}{index}" for part in parts]
        outputs = [f"recurrent{index}_{part}" for part in parts]
        kind: dict[str, Any] = {"linear_before_reset": 1} if recurrent.cell is Cell.GRU else {}
        inputs = [sequence, *weights, "", *states]
        node = helper.make_node(recurrent.cell.value.upper(), inputs, ["", *outputs], hidden_size=size, **kind)
        chain.nodes.append(node)
        shape = (1, 1, size)
        chain.remembered += [Remembered(name, shape, after) for name, after in zip(states, outputs, strict=True)]
        chain.at = chain.node("Reshape", [outputs[0], row], f"recurrent{index}_out")
    if recurrent.norm is not None:
        _append_norm(chain, recurrent.norm)


def _constants(chain: Chain, cell: Cell, layer: tuple[Array, ...], index: int) -> list[str]:
    inward, across, bias_in, bias_across = (_reordered(each, cell) for each in layer)
    bias = np.concatenate([bias_in, bias_across])
    parts = (("in", inward), ("across", across), ("bias", bias))
    return [chain.constant(f"recurrent{index}_{name}_weight", values[None]) for name, values in parts]


def _reordered(values: Array, cell: Cell) -> Array:
    """The rows of torch's gates in ONNX's order."""
    gates = np.split(values, len(GATES[cell]))
    return np.concatenate([gates[place] for place in GATES[cell]])


def _append_norm(chain: Chain, norm: tuple[Array, Array]) -> None:
    names = [chain.constant(name, values) for name, values in zip(NORM, norm, strict=True)]
    chain.at = chain.node("LayerNormalization", [chain.at, *names], "recurrent_normed", axis=1, epsilon=NORM_EPSILON)
