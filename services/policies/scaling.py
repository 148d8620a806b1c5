"""What surrounds a network: observations in physical units become its input, its output becomes an action.

x = 2 (o - low) / (high - low) - 1;  y = clip(whitening · (x - mean) / sqrt(variance + epsilon), ±clip);
action = clip(squash(network(y)), ±clip) · scale + offset.
The steps stay apart in the graph, in float32, in this order: nothing is folded that would change the numbers.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from onnx import NodeProto, TensorProto, helper, numpy_helper

from api_schemas.policy import ACTION_SIZE, ActionKind, PolicyManifest
from services.policies.unfit import UnfitError

Array = np.ndarray
WHITENING = "whitening_matrix"
INPUT_TENSORS = ("observation_low", "observation_high", "running_mean", "running_var")


@dataclass(frozen=True)
class Scaling:
    """All numbers around the network, as float64; None where there is no such step.

    ``size`` is that of what is scaled: one observation, or the stack of them.
    """

    size: int
    low: Array | None
    high: Array | None
    mean: Array | None
    variance: Array | None
    epsilon: float
    input_clip: float | None
    whitening: Array | None
    output_clip: float | None
    squash: bool
    output_scale: Array | None
    output_offset: Array | None


def scaling_of(manifest: PolicyManifest, tensors: Mapping[str, Array]) -> Scaling:
    """The manifest's numbers, and where it leaves them out those of the file's tensors.

    Raises:
        UnfitError: a list has the wrong length, is half given, or holds numbers that cannot be used.
    """
    given, size = manifest.input_scaling, _scaled_size(manifest, tensors)
    low = _vector("observation_low", given.low, tensors, size)
    high = _vector("observation_high", given.high, tensors, size)
    mean = _vector("running_mean", given.mean, tensors, size)
    variance = _vector("running_var", given.variance, tensors, size)
    for one, other, names in ((low, high, "low and high"), (mean, variance, "mean and variance")):
        if (one is None) != (other is None):
            raise UnfitError(f"input scaling needs {names} both or neither")
    if low is not None and high is not None and not (high > low).all():
        raise UnfitError("every high of the input scaling must be above its low")
    if variance is not None and (variance < 0).any():
        raise UnfitError("the input scaling's variance must not be negative")
    after = manifest.output_scaling
    return Scaling(
        *(size, low, high, mean, variance, given.epsilon, given.clip),
        _whitening(manifest, tensors, size),
        *(after.clip, after.squash == "tanh", _output_scale(manifest, tensors), _output_offset(manifest)),
    )


def _scaled_size(manifest: PolicyManifest, tensors: Mapping[str, Array]) -> int:
    """Of one observation, but of the stack where the lists are as long as that."""
    given = manifest.input_scaling
    lists = (given.low, given.high, given.mean, given.variance)
    lengths = [len(each) for each in lists if each is not None]
    lengths += [len(tensors[name]) for name in INPUT_TENSORS if name in tensors and tensors[name].ndim == 1]
    return manifest.network_inputs if manifest.network_inputs in lengths else manifest.observation_size


def _output_offset(manifest: PolicyManifest) -> Array | None:
    offset = manifest.output_scaling.offset
    if isinstance(offset, int | float):
        return np.full(ACTION_SIZE, offset)
    return _vector("offset", offset, {}, ACTION_SIZE)


def _output_scale(manifest: PolicyManifest, tensors: Mapping[str, Array]) -> Array | None:
    scale = manifest.output_scaling.scale
    if isinstance(scale, int | float):
        return np.full(ACTION_SIZE, scale)
    return _vector("torque_limit_nm", scale, tensors if manifest.action_kind == ActionKind.TORQUE else {}, ACTION_SIZE)


def _whitening(manifest: PolicyManifest, tensors: Mapping[str, Array], size: int) -> Array | None:
    given = manifest.input_scaling.whitening
    if given is None and WHITENING not in tensors:
        return None
    if given is not None and len({len(row) for row in given}) != 1:
        raise UnfitError("every row of the input scaling's whitening must have the same length")
    matrix = np.asarray(tensors[WHITENING] if given is None else given, dtype=np.float64)
    if matrix.shape != (size, size):
        raise UnfitError(f"the whitening matrix must have the shape ({size}, {size}), not {matrix.shape}", part=WHITENING)
    if not np.isfinite(matrix).all():
        raise UnfitError("it holds numbers that are not finite", part=WHITENING)
    return matrix


def _vector(name: str, given: tuple[float, ...] | None, tensors: Mapping[str, Array], size: int) -> Array | None:
    if given is None and name not in tensors:
        return None
    values = np.asarray(tensors[name] if given is None else given, dtype=np.float64)
    if values.shape != (size,):
        raise UnfitError(f"{name} must hold {size} numbers, not an array of shape {values.shape}")
    if not np.isfinite(values).all():
        raise UnfitError(f"{name} holds numbers that are not finite")
    return values


@dataclass(frozen=True)
class Remembered:
    """A state that a graph hands on to its next call: the input's name, its shape, and the value that is handed on."""

    name: str
    shape: tuple[int, ...]
    following: str


@dataclass
class Chain:
    """Nodes one after the other, each taking what the last gave and one constant; built up, then put into a graph."""

    nodes: list[NodeProto]
    constants: list[TensorProto]
    at: str
    remembered: list[Remembered] = field(default_factory=list)

    def step(self, operator: str, constant: Array) -> None:
        """Adds ``at = operator(at, constant)``."""
        name = f"{self.at}_{operator.lower()}"
        self.constants.append(numpy_helper.from_array(constant.astype(np.float32)[None, :], f"{name}_by"))
        self.nodes.append(helper.make_node(operator, [self.at, f"{name}_by"], [name]))
        self.at = name

    def constant(self, name: str, values: Array) -> str:
        """Adds a constant as it is; gives its name."""
        self.constants.append(numpy_helper.from_array(values, name))
        return name

    def node(self, operator: str, inputs: list[str], name: str, **attributes: Any) -> str:
        """Adds a node with one result; gives the result's name."""
        self.nodes.append(helper.make_node(operator, inputs, [name], **attributes))
        return name

    def clip(self, bound: float, size: int) -> None:
        """Adds a clip to ±bound. Min and Max of full size exist, unlike Clip, in the same form in every opset."""
        self.step("Min", np.full(size, bound))
        self.step("Max", np.full(size, -bound))


def before_network(scaling: Scaling, chain: Chain) -> None:
    """Goes on from what is scaled to the scaled."""
    size = scaling.size
    if scaling.low is not None and scaling.high is not None:
        chain.step("Sub", scaling.low)
        chain.step("Mul", np.full(size, 2.0))
        chain.step("Div", scaling.high - scaling.low)
        chain.step("Sub", np.ones(size))
    if scaling.mean is not None and scaling.variance is not None:
        chain.step("Sub", scaling.mean)
        chain.step("Div", np.sqrt(scaling.variance + scaling.epsilon))
    if scaling.whitening is not None:
        chain.constant("whitening", scaling.whitening.T.astype(np.float32))
        chain.at = chain.node("MatMul", [chain.at, "whitening"], "whitened")
    if scaling.input_clip is not None:
        chain.clip(scaling.input_clip, size)


def after_network(scaling: Scaling, chain: Chain) -> None:
    """Goes on from the network's nine outputs to the action."""
    if scaling.squash:
        chain.at = chain.node("Tanh", [chain.at], f"{chain.at}_tanh")
    if scaling.output_clip is not None:
        chain.clip(scaling.output_clip, ACTION_SIZE)
    if scaling.output_scale is not None:
        chain.step("Mul", scaling.output_scale)
    if scaling.output_offset is not None:
        chain.step("Add", scaling.output_offset)
