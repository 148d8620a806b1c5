"""The network as torch computes it, to hold the packed one against: its own modules, its own memory, its own formulas."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from api_schemas.policy import ACTION_SIZE, InputScaling, PolicyManifest
from api_schemas.policy_network import ActionHead
from client_cli.packing.recipe import RECURRENT, Array, Part, Recipe


class Original(Protocol):
    """A policy before it was packed."""

    def begin(self) -> None:
        """Begin a trial."""
        ...

    def act(self, observation: Array) -> Array:
        """The action (9,), in N m or rad, for an observation (n,)."""
        ...


@runtime_checkable
class Batching(Protocol):
    """An original that can be asked for many observations at once."""

    def batch(self, observations: Array, /) -> Array | None:
        """Actions (k, 9) for observations (k, n); None where each must come by itself."""
        ...


class Stack:
    """The last observations of a trial, as the manifest stacks them."""

    def __init__(self, manifest: PolicyManifest) -> None:
        self._stack = manifest.frame_stack
        self._frames: list[Array] = []

    @property
    def counts(self) -> bool:
        """Whether observations are stacked at all."""
        return self._stack is not None

    def begin(self) -> None:
        """Forget them."""
        self._frames = []

    def __call__(self, observation: Array) -> Array:
        """The row that the network takes."""
        if self._stack is None:
            return observation
        if not self._frames:
            fill = observation if self._stack.fill == "first" else np.zeros_like(observation)
            self._frames = [fill] * self._stack.count
        self._frames = [*self._frames[1:], observation]
        return np.concatenate(self._frames if self._stack.order == "oldest_first" else self._frames[::-1])


class TorchOriginal:
    """A recipe's modules in torch; ``wanted`` is the user's manifest, before it was completed, ``scale`` that of its actions."""

    def __init__(self, recipe: Recipe, wanted: PolicyManifest, scale: float | None, activation: str) -> None:
        import torch

        self._torch, self._recipe, self._wanted = torch, recipe, wanted
        self._activation = {"elu": torch.nn.functional.elu, "relu": torch.relu, "tanh": torch.tanh}[activation]
        self._modules = [_module(torch, each) for each in recipe.parts]
        self._scale = np.asarray(1.0 if (unit := wanted.output_scaling.scale if scale is None else scale) is None else unit)
        self._stack = Stack(wanted)
        self.begin()

    def begin(self) -> None:
        """Begin a trial."""
        self._memory: Any = None
        self._stack.begin()

    def act(self, observation: Array) -> Array:
        """The action (9,), in N m or rad, for an observation (n,)."""
        torch = self._torch
        whole = self._scales_whole_stack()
        row = self._stack(observation if whole else self._scaled(observation))
        with torch.no_grad():
            outputs = self._network(torch.from_numpy((self._scaled(row) if whole else row).astype(np.float32))[None])
        return self._action(outputs[0].numpy().astype(np.float64))

    def batch(self, observations: Array) -> Array | None:
        """Actions (k, 9) for observations (k, n) in one call; None for a network with memory."""
        if self._wanted.frame_stack is not None or any(each.kind in RECURRENT for each in self._recipe.parts):
            return None
        rows = np.stack([self._scaled(row) for row in observations]).astype(np.float32)
        with self._torch.no_grad():
            outputs = self._network(self._torch.from_numpy(rows))
        return np.stack([self._action(row) for row in outputs.numpy().astype(np.float64)])

    def _scales_whole_stack(self) -> bool:
        given = self._wanted.input_scaling
        length = given.mean or given.low
        size = len(length) if length else self._wanted.observation_size
        size = size if self._recipe.normaliser is None else self._recipe.normaliser.mean.size
        return size != self._wanted.observation_size

    def _scaled(self, values: Array) -> Array:
        normaliser = self._recipe.normaliser
        if normaliser is None:
            return scaled_as_stated(values, self._wanted.input_scaling)
        x, mean, variance = (each.astype(np.float64) for each in (values, normaliser.mean, normaliser.variance))
        if normaliser.outside:
            x = (x - mean) / (np.sqrt(variance) + normaliser.epsilon)
        else:
            x = (x - mean) / np.sqrt(variance + normaliser.epsilon)
        return x if normaliser.clip is None else np.clip(x, -normaliser.clip, normaliser.clip)

    def _network(self, x: Any) -> Any:
        last = len(self._modules) - 1
        for index, (each, module) in enumerate(zip(self._recipe.parts, self._modules, strict=True)):
            if each.kind in RECURRENT:
                x, self._memory = module(x[None], self._memory)
                x = x[0]
            elif each.kind == "norm" or index == last:
                x = module(x)
            else:
                x = self._activation(module(x))
        return x

    def _action(self, outputs: Array) -> Array:
        recipe, wanted = self._recipe, self._wanted
        head, bins = (recipe.head, recipe.bins) if recipe.head is not ActionHead.DIRECT else (wanted.head, wanted.bins)
        values = outputs[:ACTION_SIZE]
        if head is ActionHead.BINS:
            assert bins is not None, "a head of bins says how many"
            values = outputs.reshape(ACTION_SIZE, bins).argmax(1) * 2 / (bins - 1) - 1
        if recipe.squash or wanted.output_scaling.squash:
            values = np.tanh(values)
        clip = recipe.clip or (None if recipe.squash or not recipe.clips else wanted.output_scaling.clip)
        values = values if clip is None else np.clip(values, -clip, clip)
        values = values if recipe.factor is None else values * recipe.factor
        values = values if recipe.shift is None else values + recipe.shift
        offset = wanted.output_scaling.offset if recipe.shift is None else None
        return values * self._scale + (0.0 if offset is None else np.asarray(offset))


def _module(torch: Any, part: Part) -> Any:
    if part.kind == "linear":
        module = torch.nn.Linear(part.takes, part.gives)
    elif part.kind == "norm":
        module = torch.nn.LayerNorm(part.gives)
    else:
        kind = torch.nn.LSTM if part.kind == "lstm" else torch.nn.GRU
        module = kind(part.takes, part.gives, sum(name.startswith("weight_hh_l") for name in part.tensors))
    module.load_state_dict({name: torch.from_numpy(np.array(values)) for name, values in part.tensors.items()})
    return module.float()


def scaled_as_stated(values: Array, scaling: InputScaling) -> Array:
    """What a manifest's input scaling makes of an observation or a stack of them, in float64."""
    x = values.astype(np.float64)
    if scaling.low is not None and scaling.high is not None:
        low, high = np.array(scaling.low), np.array(scaling.high)
        x = 2 * (x - low) / (high - low) - 1
    if scaling.mean is not None and scaling.variance is not None:
        x = (x - np.array(scaling.mean)) / np.sqrt(np.array(scaling.variance) + scaling.epsilon)
    if scaling.whitening is not None:
        x = np.array(scaling.whitening) @ x
    return x if scaling.clip is None else np.clip(x, -scaling.clip, scaling.clip)
