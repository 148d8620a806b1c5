"""A trained actor as the farm takes it: weights with their input scaling in one safetensors file, and its manifest."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import load_file, save_file

from api_schemas.policy import InputScaling, PolicyManifest
from api_schemas.policy_network import ActionHead, Cell
from sim_backend.training.actor_critic import CLIP, EPSILON, ActorCritic, Inputs
from sim_backend.training.recurrent import Memory, RecurrentActorCritic

ACTIVATIONS = {
    "elu": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0))),
    "relu": lambda x: np.maximum(x, 0),
    "tanh": np.tanh,
}


class ExportedPolicy:
    """A policy from its file, for many trials at once; what the farm makes of the same file gives the same actions.

    ``layers`` has weight (inputs, outputs) and bias (outputs,) of each layer.
    """

    def __init__(self, tensors: dict[str, np.ndarray], manifest: PolicyManifest) -> None:
        self.tensors, self.manifest = tensors, manifest
        self._centre, self._spread = input_scaling_of(tensors, manifest)
        self._activation = ACTIVATIONS[manifest.activation]
        self.layers = [(tensors[f"layer{i}.weight"].T, tensors[f"layer{i}.bias"]) for i in range(count_layers(tensors))]
        self._memory = Memory(tensors, manifest.recurrent) if manifest.recurrent else None

    def begin(self, trials: int) -> None:
        """Forget all that was, and begin that many trials."""
        if self._memory is not None:
            self._memory.begin(trials)

    def forget(self, rows: np.ndarray) -> None:
        """Some trials, by their index, begin anew while others go on."""
        if self._memory is not None:
            self._memory.forget(rows)

    @property
    def remembered(self) -> np.ndarray | None:
        """What the cells hold of each trial, shape (n, cells); None without a memory."""
        return None if self._memory is None else self._memory.hidden

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Actions (n, 9), as the manifest means them, for observations (n, size)."""
        clip, after = self.manifest.input_scaling.clip, self.manifest.output_scaling
        x = (observation - self._centre) / self._spread
        if clip is not None:
            x = np.clip(x, -clip, clip)
        if self._memory is not None:
            x = self._memory(x)
        for weight, bias in self.layers[:-1]:
            x = self._activation(x @ weight + bias)
        x = x @ self.layers[-1][0] + self.layers[-1][1]
        if self.manifest.head is ActionHead.BINS:
            assert self.manifest.bins is not None
            x = np.linspace(-1, 1, self.manifest.bins)[x.reshape(len(x), 9, -1).argmax(axis=2)]
        if after.clip is not None:
            x = np.clip(x, -after.clip, after.clip)
        return x * self._scale + np.asarray(0.0 if after.offset is None else after.offset)

    @property
    def _scale(self) -> np.ndarray:
        scale = self.manifest.output_scaling.scale
        return self.tensors["torque_limit_nm"] if scale is None else np.asarray(scale)


def count_layers(tensors: Mapping[str, np.ndarray]) -> int:
    """Layers after the memory, if there is one."""
    return sum(name.startswith("layer") and name.endswith(".weight") for name in tensors)


def input_scaling_of(tensors: Mapping[str, np.ndarray], manifest: PolicyManifest) -> tuple[np.ndarray, np.ndarray]:
    """What is taken from an observation, and what it is then divided by, each of shape (size,): bounds and spread in one."""
    n, given = manifest.observation_size, manifest.input_scaling
    pairs = (
        ("observation_low", given.low, -1.0),
        ("observation_high", given.high, 1.0),
        ("running_mean", given.mean, 0.0),
        ("running_var", given.variance, 1.0),
    )
    low, high, mean, variance = (
        np.asarray(values if values is not None else tensors.get(name, np.full(n, absent)), dtype=np.float32)
        for name, values, absent in pairs
    )
    half, middle = (high - low) / 2, (high + low) / 2
    has_variance = given.variance is not None or "running_var" in tensors
    deviation = np.sqrt(variance + np.float32(given.epsilon)) if has_variance else np.ones_like(variance)
    return middle + mean * half, deviation * half


def exported(policy: ActorCritic | RecurrentActorCritic, manifest: PolicyManifest, name: str) -> ExportedPolicy:
    """The actor alone."""
    cells = (Cell.LSTM, policy.lstm_actor) if isinstance(policy, RecurrentActorCritic) else None
    layers = [*policy.actor_layers, policy.action_net]
    return exported_network(policy.features_extractor, layers, cells, manifest, name)


def exported_network(
    inputs: Inputs,
    layers: Sequence[torch.nn.Module],
    cells: tuple[Cell, torch.nn.Module] | None,
    manifest: PolicyManifest,
    name: str,
) -> ExportedPolicy:
    """Linear layers, cells before them if any; what they take from differences of places goes into the first, as the same sum."""
    tensors, scaled = {}, {"name": name, "input_scaling": InputScaling(clip=CLIP, epsilon=EPSILON)}
    for i, layer in enumerate(layers):
        tensors |= {f"layer{i}.{key}": _numbers(values) for key, values in layer.named_parameters()}
    first = "layer0.weight", "layer0.bias"
    if cells is not None:
        scaled["recurrent"], memory = cells
        tensors |= {f"recurrent.{key}": _numbers(values) for key, values in memory.named_parameters()}
        first = "recurrent.weight_ih_l0", "recurrent.bias_ih_l0"
    tensors |= _without_differences(inputs, first, tensors)
    as_float32 = {key: np.ascontiguousarray(value, dtype=np.float32) for key, value in tensors.items()}
    return ExportedPolicy(as_float32, manifest.model_copy(update=scaled))


def _without_differences(inputs: Inputs, names: tuple[str, str], tensors: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Weight and bias of the layer that takes the inputs, for an observation that is only scaled; and that scaling."""
    n, (weight, bias) = inputs.seen, (tensors[name] for name in names)
    mean, variance = _numbers(inputs.mean)[:n], _numbers(inputs.variance)[:n]
    of_differences = weight[:, n:] @ _numbers(inputs.differences)
    weight, bias = weight[:, :n] + of_differences * np.sqrt(variance + EPSILON), bias + of_differences @ mean
    return {names[0]: weight, names[1]: bias, "running_mean": mean, "running_var": variance}


def _numbers(tensor) -> np.ndarray:
    return tensor.detach().double().numpy()


def write_policy(policy: ExportedPolicy, folder: Path, name: str) -> Path:
    """Write ``NAME.safetensors`` and ``NAME.json`` (the manifest); returns the path of the weights."""
    path = folder / f"{name}.safetensors"
    save_file(policy.tensors, path)
    path.with_suffix(".json").write_text(policy.manifest.model_dump_json(indent=2) + "\n")
    return path


def read_policy(path: Path, layout: PolicyManifest | None = None) -> ExportedPolicy:
    """A policy as :func:`write_policy` writes it, or weights without a manifest beside them, which then need a layout.

    Raises:
        ValueError: the weights or the manifest are not there.
    """
    beside = path.with_suffix(".json")
    if not path.is_file():
        raise ValueError(f"there is no policy {path}; name the safetensors file of one")
    if layout is None and not beside.is_file():
        raise ValueError(f"{path.name} has no manifest beside it; write {beside.name}, or name a layout")
    manifest = layout or PolicyManifest.model_validate_json(beside.read_text())
    if manifest.frame_stack or manifest.states or manifest.output_scaling.squash or manifest.head is ActionHead.GAUSSIAN:
        raise ValueError(
            f"{path.name} stacks, squashes or has a graph's states; what trains here reads plain layers and cells only"
        )
    return ExportedPolicy(load_file(path), manifest)
