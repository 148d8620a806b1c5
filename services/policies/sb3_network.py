"""The network of a stable-baselines3 policy, rebuilt from the names and shapes of its tensors.

What comes out is what ``model.predict(observation, deterministic=True)`` gives, clipped to the bounds of the actions.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from onnx import NodeProto, TensorProto, helper, numpy_helper

from api_schemas.policy import ACTION_SIZE, PolicyManifest
from services.policies.sb3_archive import WEIGHTS, Settings, check_entries_of, read_settings
from services.policies.torch_file import read_tensors
from services.policies.unfit import UnfitError, wrong_input, wrong_output
from services.policies.uploaded import PREFIX, Uploaded
from services.policies.zip_directory import inflate

OPSET, IR_VERSION = 17, 8
Array = np.ndarray
PARTS = re.compile(
    r"(mlp_extractor\.policy_net|action_net|actor\.(latent_pi|mu|features_extractor)|lstm_actor|(pi_)?features_extractor)\..+"
)
"""The tensors that an action depends on; those of critics, of targets and of the spread are not even read."""


@dataclass(frozen=True)
class Family:
    """How one family of algorithms names the layers of its policy, and what it does around them."""

    hidden: str
    last: str
    activation: str
    squashed: bool


ACTOR_CRITIC = Family("mlp_extractor.policy_net", "action_net", "Tanh", squashed=False)
SAC = Family("actor.latent_pi", "actor.mu", "Relu", squashed=True)
SAC_CLIPPED = Family("actor.latent_pi", "actor.mu.0", "Relu", squashed=True)
TD3 = Family("actor.mu", "", "Relu", squashed=True)
"""PPO and A2C; SAC, and the same with gSDE, which clips the mean; TD3 and DDPG, whose last layer is numbered like the others."""


def read_archive(content: memoryview, limit_bytes: int, manifest: PolicyManifest) -> Uploaded:
    """The policy of an archive as nodes, from the observation that it was trained on to its action.

    Raises:
        UnfitError: the archive is not well formed, or its policy is none that can be rebuilt.
    """
    entries = check_entries_of(content, limit_bytes)
    settings = read_settings(content, entries)
    wanted = read_tensors(inflate(content, entries[WEIGHTS]), limit_bytes, lambda name: bool(PARTS.fullmatch(name)))
    return rebuilt(wanted, settings, manifest)


def rebuilt(tensors: Mapping[str, Array], settings: Settings, manifest: PolicyManifest) -> Uploaded:
    """The nodes of a policy whose tensors have the names of stable-baselines3.

    Raises:
        UnfitError: a tensor is missing, is none of a feed-forward network or has the wrong shape.
    """
    family = _family(tensors)
    low, high = _bounds(settings)
    layers = _layers(tensors, family)
    _check_shapes(layers, manifest)
    chain = _Chain([], [], f"{PREFIX}obs")
    activation = settings.activation or family.activation
    for index, (weight, bias) in enumerate(layers):
        chain.linear(weight, bias)
        if index < len(layers) - 1:
            chain.unary(activation)
    if family == SAC_CLIPPED and settings.mean_clip > 0:
        chain.binary("Min", np.full(ACTION_SIZE, settings.mean_clip))
        chain.binary("Max", np.full(ACTION_SIZE, -settings.mean_clip))
    if family.squashed or settings.squashed:
        chain.unary("Tanh")
        # As stable-baselines3 does it: low + (high - low) / 2 · (x + 1).
        chain.binary("Add", np.ones(ACTION_SIZE))
        chain.binary("Mul", 0.5 * (high - low))
        chain.binary("Add", low)
    else:
        chain.binary("Min", high)
        chain.binary("Max", low)
    return Uploaded(chain.nodes, chain.constants, f"{PREFIX}obs", chain.at, OPSET, IR_VERSION)


def _family(tensors: Mapping[str, Array]) -> Family:
    if any(name.startswith("lstm_actor.") for name in tensors):
        raise UnfitError(
            "a recurrent policy (RecurrentPPO) is not rebuilt from its archive", part="entry policy.pth", slug="network-unknown",
            pack=True,
        )  # fmt: skip
    other = next((name for name in tensors if "features_extractor." in name), None)
    if other is not None:
        raise UnfitError(
            "a features extractor with weights of its own (a network for images or for several inputs) is not rebuilt",
            part=f"tensor {other!r:.100}",
            slug="network-unknown",
            pack=True,
        )
    if "action_net.weight" in tensors:
        return ACTOR_CRITIC
    if "actor.mu.weight" in tensors:
        return SAC
    if any(name.startswith("actor.latent_pi.") for name in tensors):
        return SAC_CLIPPED
    if any(name.startswith("actor.mu.") for name in tensors):
        return TD3
    raise UnfitError(
        "no policy of PPO, A2C, SAC, TD3 or DDPG is in it", part="entry policy.pth", slug="network-unknown", pack=True
    )


def _layers(tensors: Mapping[str, Array], family: Family) -> list[tuple[Array, Array]]:
    """Weights and biases from the first layer to the last."""
    stem = re.compile(re.escape(family.hidden) + r"\.(\d{1,3})\..*")
    numbers = sorted({int(found[1]) for found in map(stem.fullmatch, tensors) if found})
    # A layer, its activation, the next layer: any other step is a norm or a dropout, which would be left out in silence.
    if numbers != list(range(0, 2 * len(numbers), 2)) or (not numbers and not family.last):
        raise UnfitError(
            f"its layers are numbered {numbers}, not 0, 2, 4 …: a norm or another module lies between them",
            part=f"tensors {family.hidden}",
            slug="network-unknown",
            pack=True,
        )
    names = [f"{family.hidden}.{number}" for number in numbers] + ([family.last] if family.last else [])
    return [_pair(tensors, name) for name in names]


def _pair(tensors: Mapping[str, Array], name: str) -> tuple[Array, Array]:
    found = []
    for part in ("weight", "bias"):
        values = tensors.get(f"{name}.{part}")
        if values is None or values.dtype.kind != "f":
            raise UnfitError("there is no such tensor of floats", part=f"tensor {name}.{part}", slug="network-unknown", pack=True)
        with np.errstate(over="ignore"):
            values = values.astype(np.float32)
        if not np.isfinite(values).all():
            raise UnfitError(
                "it holds numbers that are not finite", part=f"tensor {name}.{part}", slug="weights-not-finite",
                instead="send weights from before the training diverged",
            )  # fmt: skip
        found.append(values)
    return found[0], found[1]


def _check_shapes(layers: list[tuple[Array, Array]], manifest: PolicyManifest) -> None:
    for index, (weight, bias) in enumerate(layers):
        if weight.ndim != 2 or bias.shape != weight.shape[:1] or 0 in weight.shape:
            raise _misshapen(index, f"weight {weight.shape} and bias {bias.shape} must be (out, in) and (out,)")
        if index and weight.shape[1] != layers[index - 1][0].shape[0]:
            raise _misshapen(index, f"it takes {weight.shape[1]} numbers, the one before gives {layers[index - 1][0].shape[0]}")
    if layers[0][0].shape[1] != manifest.observation_size:
        raise wrong_input(manifest, layers[0][0].shape[1])
    if layers[-1][0].shape[0] != ACTION_SIZE:
        raise wrong_output(layers[-1][0].shape[0])


def _misshapen(index: int, why: str) -> UnfitError:
    return UnfitError(why, part=f"layer {index} of policy.pth", slug="weights-malformed")


def _bounds(settings: Settings) -> tuple[Array, Array]:
    """The bounds of the action space.

    Raises:
        UnfitError: the archive does not say them as nine numbers each.
    """
    low, high = settings.low, settings.high
    fits = low is not None and high is not None and len(low) == len(high) == ACTION_SIZE
    if not fits or not all(one < other for one, other in zip(low or (), high or (), strict=True)):
        raise UnfitError(
            f"its action space is not a Box of {ACTION_SIZE} numbers with a low below each high",
            part="entry data, action_space",
            slug="action-does-not-fit",
            pack=True,
        )
    return np.array(low), np.array(high)


@dataclass
class _Chain:
    """Nodes one after the other, each taking what the last gave."""

    nodes: list[NodeProto]
    constants: list[TensorProto]
    at: str

    def linear(self, weight: Array, bias: Array) -> None:
        names = [self._constant("weight", weight), self._constant("bias", bias)]
        self._add("Gemm", *names)
        self.nodes[-1].attribute.append(helper.make_attribute("transB", 1))

    def unary(self, operator: str) -> None:
        self._add(operator)

    def binary(self, operator: str, values: Array) -> None:
        self._add(operator, self._constant("by", values.astype(np.float32)[None, :]))

    def _constant(self, what: str, values: Array) -> str:
        name = f"{PREFIX}{what}{len(self.nodes)}"
        self.constants.append(numpy_helper.from_array(values, name))
        return name

    def _add(self, operator: str, *names: str) -> None:
        out = f"{PREFIX}step{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, [self.at, *names], [out]))
        self.at = out
