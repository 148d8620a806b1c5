"""A trained actor as the farm takes it: weights with their input scaling in one safetensors file, and its manifest."""

from pathlib import Path

import numpy as np
from safetensors.numpy import load_file, save_file

from api_schemas.policy import InputScaling, PolicyManifest
from api_schemas.policy_network import ActionHead, Cell
from sim_backend.training.actor_critic import CLIP, EPSILON, ActorCritic, Inputs
from sim_backend.training.recurrent import Memory, RecurrentActorCritic


class ExportedPolicy:
    """A policy from its file, for many trials at once; what the farm makes of the same file gives the same actions."""

    def __init__(self, tensors: dict[str, np.ndarray], manifest: PolicyManifest) -> None:
        self.tensors, self.manifest = tensors, manifest
        layers = sum(name.startswith("layer") and name.endswith(".weight") for name in tensors)
        self._layers = [(tensors[f"layer{i}.weight"].T, tensors[f"layer{i}.bias"]) for i in range(layers)]
        self._memory = Memory(tensors) if manifest.recurrent else None

    def begin(self, trials: int) -> None:
        """Forget all that was, and begin that many trials."""
        if self._memory is not None:
            self._memory.begin(trials)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Actions (n, 9), as the manifest means them, for observations (n, size)."""
        scaling, after = self.manifest.input_scaling, self.manifest.output_scaling
        deviation = np.sqrt(self.tensors["running_var"] + np.float32(scaling.epsilon))
        x = (observation - self.tensors["running_mean"]) / deviation
        if scaling.clip is not None:
            x = np.clip(x, -scaling.clip, scaling.clip)
        if self._memory is not None:
            x = self._memory(x)
        for weight, bias in self._layers[:-1]:
            x = x @ weight + bias
            x = np.where(x > 0, x, np.expm1(np.minimum(x, 0)))
        x = x @ self._layers[-1][0] + self._layers[-1][1]
        if self.manifest.head is ActionHead.BINS:
            assert self.manifest.bins is not None
            x = np.linspace(-1, 1, self.manifest.bins)[x.reshape(len(x), 9, -1).argmax(axis=2)]
        if after.clip is not None:
            x = np.clip(x, -after.clip, after.clip)
        return x * np.asarray(after.scale) + np.asarray(0.0 if after.offset is None else after.offset)


def exported(policy: ActorCritic | RecurrentActorCritic, manifest: PolicyManifest, name: str) -> ExportedPolicy:
    """The actor alone; what it takes from differences of places goes into its first layer, which is the same sum."""
    tensors, scaled = {}, {"name": name, "input_scaling": InputScaling(clip=CLIP, epsilon=EPSILON)}
    for i, layer in enumerate([*policy.actor_layers, policy.action_net]):
        tensors |= {f"layer{i}.weight": _numbers(layer.weight), f"layer{i}.bias": _numbers(layer.bias)}
    first = "layer0.weight", "layer0.bias"
    if isinstance(policy, RecurrentActorCritic):
        tensors |= {f"recurrent.{key}": _numbers(values) for key, values in policy.lstm_actor.named_parameters()}
        first, scaled["recurrent"] = ("recurrent.weight_ih_l0", "recurrent.bias_ih_l0"), Cell.LSTM
    tensors |= _without_differences(policy.features_extractor, first, tensors)
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


def read_policy(path: Path) -> ExportedPolicy:
    """A policy as :func:`write_policy` writes it."""
    return ExportedPolicy(load_file(path), PolicyManifest.model_validate_json(path.with_suffix(".json").read_text()))
