"""A network from safetensors: ``layer{i}.weight`` (out, in) and ``layer{i}.bias``, activation between, none after the last.

With memory, ``recurrent.*`` comes before the layers, and before that ``encoder{i}.*`` with the activation after each, if any.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from onnx import NodeProto, TensorProto, helper, numpy_helper

from api_schemas.policy import PolicyManifest
from services.policies import recurrent
from services.policies.recurrent import Recurrent
from services.policies.scaling import Chain
from services.policies.unfit import UnfitError, wrong_input, wrong_output

ACTIVATIONS = {"elu": "Elu", "relu": "Relu", "tanh": "Tanh"}
SCALING_TENSORS = frozenset({"observation_low", "observation_high", "running_mean", "running_var", "torque_limit_nm"})
Array = np.ndarray
Layer = tuple[Array, Array]


@dataclass(frozen=True)
class Network:
    """A checked network: layers before the memory and the memory itself, if there are any, and layers after it."""

    encoder: list[Layer]
    memory: Recurrent | None
    layers: list[Layer]


def read(tensors: Mapping[str, Array], manifest: PolicyManifest) -> Network:
    """The network as float32, its parts checked against each other and the manifest.

    Raises:
        UnfitError: a tensor is missing, unknown or of the wrong shape.
    """
    if manifest.states:
        raise UnfitError("states are for ONNX; a safetensors file's memory is declared with recurrent: lstm or gru")
    _check_names(tensors, manifest)
    encoder = _layers(tensors, "encoder") if manifest.recurrent else []
    layers = _layers(tensors, "layer")
    size = _check_chain(encoder, "encoder", manifest.network_inputs, manifest)
    memory = None
    if manifest.recurrent:
        given = {name: _float32(tensors, name) for name in recurrent.names(tensors)}
        if not encoder and given["recurrent.weight_ih_l0"].shape[1:] != (size,):
            raise wrong_input(manifest, given["recurrent.weight_ih_l0"].shape[-1])
        memory = recurrent.read(given, manifest, size)
        size = memory.size
    gives = _check_chain(layers, "layer", size, manifest)
    if gives != manifest.network_outputs:
        raise wrong_output(gives, manifest)
    return Network(encoder, memory, layers)


def _check_names(tensors: Mapping[str, Array], manifest: PolicyManifest) -> None:
    counted = {"layer": max(1, _count(tensors, "layer"))} | (
        {"encoder": _count(tensors, "encoder")} if manifest.recurrent else {}
    )
    wanted = {f"{kind}{i}.{part}" for kind, count in counted.items() for i in range(count) for part in ("weight", "bias")}
    if manifest.recurrent:
        wanted |= recurrent.names(tensors)
    unknown, missing = sorted(set(tensors) - wanted - SCALING_TENSORS), sorted(wanted - set(tensors))
    if not unknown and not missing:
        return
    memory = "recurrent.weight_ih_l0 … as torch names them, " if manifest.recurrent else ""
    hint = "; a file with memory needs recurrent in its manifest" if any(n.startswith("recurrent.") for n in unknown) else ""
    if not hint and missing and any(name.endswith(".weight") for name in unknown):
        hint = "; `trifarm pack FILE` makes such a file of a state_dict as torch names it"
    raise UnfitError(
        f"the file must hold {memory}layer0.weight, layer0.bias, layer1.weight … "
        f"and may hold {', '.join(sorted(SCALING_TENSORS))}; "
        f"missing: {', '.join(missing) or 'none'}, unknown: {', '.join(unknown) or 'none'}{hint}"
    )


def _count(tensors: Mapping[str, Array], kind: str) -> int:
    return sum(name.startswith(kind) and name.endswith(".weight") for name in tensors)


def _layers(tensors: Mapping[str, Array], kind: str) -> list[Layer]:
    pairs = range(_count(tensors, kind))
    return [(_float32(tensors, f"{kind}{i}.weight"), _float32(tensors, f"{kind}{i}.bias")) for i in pairs]


def _check_chain(pairs: list[Layer], kind: str, takes: int, manifest: PolicyManifest) -> int:
    """Checks layers that follow each other, the first of which takes ``takes`` numbers; gives what the last gives."""
    for index, (weight, bias) in enumerate(pairs):
        if weight.ndim != 2 or bias.shape != (weight.shape[0],):
            raise UnfitError(f"{kind}{index}: weight {weight.shape} and bias {bias.shape} must be (out, in) and (out,)")
        if weight.shape[1] != takes:
            if index:
                raise UnfitError(f"{kind}{index} takes {weight.shape[1]} numbers, {kind}{index - 1} gives {takes}")
            if manifest.recurrent and kind == "layer":
                raise UnfitError(f"layer0 takes {weight.shape[1]} numbers, the memory gives {takes}")
            raise wrong_input(manifest, weight.shape[1])
        takes = weight.shape[0]
    return takes


def _float32(tensors: Mapping[str, Array], name: str) -> Array:
    values = tensors[name].astype(np.float32)
    if not np.isfinite(values).all():
        raise UnfitError(f"tensor {name} holds numbers that are not finite in float32")
    return values


def append(chain: Chain, network: Network, activation: str) -> None:
    """Goes on from the network's input to its output; the states of its memory are remembered."""
    for index, layer in enumerate(network.encoder):
        given = _linear(chain, layer, f"encoder{index}_")
        chain.at = chain.node(ACTIVATIONS[activation], [given], f"encoder{index}_hidden")
    if network.memory is not None:
        recurrent.append(chain, network.memory)
    nodes, constants, chain.at = _hidden(network.layers, activation, chain.at)
    chain.nodes += nodes
    chain.constants += constants


def _linear(chain: Chain, layer: Layer, prefix: str) -> str:
    names = [chain.constant(f"{prefix}{part}", values) for part, values in zip(("weight", "bias"), layer, strict=True)]
    return chain.node("Gemm", [chain.at, *names], f"{prefix}linear", transB=1)


def _hidden(pairs: list[Layer], activation: str, given: str) -> tuple[list[NodeProto], list[TensorProto], str]:
    made, constants = [], []
    for index, (weight, bias) in enumerate(pairs):
        constants += [numpy_helper.from_array(weight, f"weight{index}"), numpy_helper.from_array(bias, f"bias{index}")]
        made.append(helper.make_node("Gemm", [given, f"weight{index}", f"bias{index}"], [f"linear{index}"], transB=1))
        given = f"linear{index}"
        if index < len(pairs) - 1:
            made.append(helper.make_node(ACTIVATIONS[activation], [given], [f"hidden{index}"]))
            given = f"hidden{index}"
    return made, constants, given
