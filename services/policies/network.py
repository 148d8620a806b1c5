"""An MLP from safetensors as an ONNX graph: ``layer{i}.weight`` (out, in) and ``layer{i}.bias``, activation between."""

from collections.abc import Mapping

import numpy as np
from onnx import NodeProto, TensorProto, helper, numpy_helper

from api_schemas.policy import ACTION_SIZE, PolicyManifest
from services.policies.unfit import UnfitError, wrong_input, wrong_output

ACTIVATIONS = {"elu": "Elu", "relu": "Relu", "tanh": "Tanh"}
SCALING_TENSORS = frozenset({"observation_low", "observation_high", "running_mean", "running_var", "torque_limit_nm"})
Array = np.ndarray


def layers(tensors: Mapping[str, Array], manifest: PolicyManifest) -> list[tuple[Array, Array]]:
    """The layers' weights and biases in order, as float32, checked against each other and the manifest.

    Raises:
        UnfitError: a tensor is missing, unknown or of the wrong shape.
    """
    count = sum(name.startswith("layer") and name.endswith(".weight") for name in tensors)
    wanted = {f"layer{index}.{part}" for index in range(count) for part in ("weight", "bias")}
    names = set(tensors)
    if count == 0 or not wanted <= names or names - wanted - SCALING_TENSORS:
        unknown, missing = sorted(names - wanted - SCALING_TENSORS), sorted(wanted - names)
        raise UnfitError(
            "the file must hold layer0.weight, layer0.bias, layer1.weight … "
            f"and may hold {', '.join(sorted(SCALING_TENSORS))}; "
            f"missing: {', '.join(missing) or 'none'}, unknown: {', '.join(unknown) or 'none'}"
        )
    pairs = [(_float32(tensors, f"layer{i}.weight"), _float32(tensors, f"layer{i}.bias")) for i in range(count)]
    _check_chain(pairs, manifest)
    return pairs


def _check_chain(pairs: list[tuple[Array, Array]], manifest: PolicyManifest) -> None:
    for index, (weight, bias) in enumerate(pairs):
        if weight.ndim != 2 or bias.shape != (weight.shape[0],):
            raise UnfitError(f"layer{index}: weight {weight.shape} and bias {bias.shape} must be (out, in) and (out,)")
        if index and weight.shape[1] != pairs[index - 1][0].shape[0]:
            raise UnfitError(
                f"layer{index} takes {weight.shape[1]} numbers, layer{index - 1} gives {pairs[index - 1][0].shape[0]}"
            )
    if pairs[0][0].shape[1] != manifest.observation_size:
        raise wrong_input(manifest, pairs[0][0].shape[1])
    if pairs[-1][0].shape[0] != ACTION_SIZE:
        raise wrong_output(pairs[-1][0].shape[0])


def _float32(tensors: Mapping[str, Array], name: str) -> Array:
    values = tensors[name].astype(np.float32)
    if not np.isfinite(values).all():
        raise UnfitError(f"tensor {name} holds numbers that are not finite in float32")
    return values


def nodes(pairs: list[tuple[Array, Array]], activation: str, given: str) -> tuple[list[NodeProto], list[TensorProto], str]:
    """The layers as ONNX nodes with their constants, and the name of what they give; ``given`` names their input."""
    made, constants = [], []
    for index, (weight, bias) in enumerate(pairs):
        constants += [numpy_helper.from_array(weight, f"weight{index}"), numpy_helper.from_array(bias, f"bias{index}")]
        made.append(helper.make_node("Gemm", [given, f"weight{index}", f"bias{index}"], [f"linear{index}"], transB=1))
        given = f"linear{index}"
        if index < len(pairs) - 1:
            made.append(helper.make_node(ACTIVATIONS[activation], [given], [f"hidden{index}"]))
            given = f"hidden{index}"
    return made, constants, given
