"""The network of a stable-baselines3 policy, rebuilt from the names and shapes of its tensors.

What comes out is what ``model.predict(observation, deterministic=True)`` gives: of a recurrent policy with its own last states,
which are zero at the beginning of a trial. Of a MultiDiscrete action space it is the centres of the chosen bins, which lie evenly
in [-1, 1].
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from api_schemas.policy import ACTION_SIZE, PolicyManifest
from api_schemas.policy_network import MOST_BINS, ActionHead, Cell
from services.policies import recurrent
from services.policies.heads import take_action
from services.policies.sb3_archive import WEIGHTS, Settings, check_entries_of, read_settings
from services.policies.scaling import Chain
from services.policies.torch_file import read_tensors
from services.policies.unfit import UnfitError, not_finite, wrong_input, wrong_output
from services.policies.uploaded import PREFIX, Uploaded
from services.policies.zip_directory import inflate

OPSET, IR_VERSION = 17, 8
GIVEN, MEMORY = f"{PREFIX}obs", "lstm_actor."
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
"""PPO, A2C and RecurrentPPO; SAC, and the same with gSDE, which clips the mean; TD3 and DDPG, its last layer numbered too."""


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
    _check_manifest(manifest)
    family = _family(tensors)
    bins = _bins(settings)
    low, high = _bounds(settings) if bins is None else (np.empty(0), np.empty(0))
    memory = _memory(tensors, manifest)
    layers = _layers(tensors, family)
    _check_shapes(layers, memory, manifest, ACTION_SIZE * (bins or 1))
    chain = Chain([], [], GIVEN)
    if memory is not None:
        recurrent.append(chain, memory)
    activation = settings.activation or family.activation
    for index, (weight, bias) in enumerate(layers):
        names = [chain.constant(f"{PREFIX}{part}{index}", values) for part, values in (("weight", weight), ("bias", bias))]
        chain.at = chain.node("Gemm", [chain.at, *names], f"{PREFIX}linear{index}", transB=1)
        if index < len(layers) - 1:
            chain.at = chain.node(activation, [chain.at], f"{PREFIX}hidden{index}")
    if family == SAC_CLIPPED and settings.mean_clip > 0:
        chain.clip(settings.mean_clip, ACTION_SIZE)
    if bins is not None:
        take_action(chain, manifest.model_copy(update={"head": ActionHead.BINS, "bins": bins}))
    elif family.squashed or settings.squashed:
        chain.at = chain.node("Tanh", [chain.at], f"{PREFIX}squashed")
        # As stable-baselines3 does it: low + (high - low) / 2 · (x + 1).
        chain.step("Add", np.ones(ACTION_SIZE))
        chain.step("Mul", 0.5 * (high - low))
        chain.step("Add", low)
    else:
        chain.step("Min", high)
        chain.step("Max", low)
    states = [(each.name, each.following, each.shape) for each in chain.remembered]
    return Uploaded(chain.nodes, chain.constants, GIVEN, chain.at, OPSET, IR_VERSION, states)


def _check_manifest(manifest: PolicyManifest) -> None:
    if manifest.recurrent is not None or manifest.states:
        raise UnfitError(
            "an archive says itself what its policy remembers",
            part="the manifest",
            instead="leave out recurrent and states",
            slug="manifest-does-not-fit",
        )
    if manifest.network_outputs != ACTION_SIZE:
        raise wrong_output(ACTION_SIZE, manifest)


def _memory(tensors: Mapping[str, Array], manifest: PolicyManifest) -> recurrent.Recurrent | None:
    """The LSTM of RecurrentPPO, which lies between the observation and the layers."""
    lstm = {name.removeprefix(MEMORY): values for name, values in tensors.items() if name.startswith(MEMORY)}
    if not lstm:
        return None
    cells = {f"recurrent.{name}": _floats(values, MEMORY + name) for name, values in lstm.items()}
    first = cells.get("recurrent.weight_ih_l0")
    if set(cells) != recurrent.names(cells) or first is None or first.ndim != 2:
        raise UnfitError(
            "its memory is none that can be rebuilt: layers of an LSTM in one direction, with biases",
            part=f"tensors {MEMORY[:-1]}",
            slug="network-unknown",
            pack=True,
        )
    if first.shape[1] != manifest.network_inputs:
        raise wrong_input(manifest, first.shape[1])
    return recurrent.read(cells, manifest.model_copy(update={"recurrent": Cell.LSTM}), manifest.network_inputs)


def _family(tensors: Mapping[str, Array]) -> Family:
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
        "no policy of PPO, A2C, RecurrentPPO, SAC, TD3 or DDPG is in it",
        part="entry policy.pth",
        slug="network-unknown",
        pack=True,
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
        found.append(_floats(values, f"{name}.{part}"))
    return found[0], found[1]


def _floats(values: Array | None, name: str) -> Array:
    if values is None or values.dtype.kind != "f":
        raise UnfitError("there is no such tensor of floats", part=f"tensor {name}", slug="network-unknown", pack=True)
    with np.errstate(over="ignore"):
        values = values.astype(np.float32)
    if not np.isfinite(values).all():
        raise not_finite(f"tensor {name}")
    return values


def _check_shapes(
    layers: list[tuple[Array, Array]], memory: recurrent.Recurrent | None, manifest: PolicyManifest, gives: int
) -> None:
    for index, (weight, bias) in enumerate(layers):
        if weight.ndim != 2 or bias.shape != weight.shape[:1] or 0 in weight.shape:
            raise _misshapen(index, f"weight {weight.shape} and bias {bias.shape} must be (out, in) and (out,)")
        if index and weight.shape[1] != layers[index - 1][0].shape[0]:
            raise _misshapen(index, f"it takes {weight.shape[1]} numbers, the one before gives {layers[index - 1][0].shape[0]}")
    takes = layers[0][0].shape[1]
    if memory is not None and takes != memory.size:
        raise _misshapen(0, f"it takes {takes} numbers, the memory gives {memory.size}")
    if memory is None and takes != manifest.network_inputs:
        raise wrong_input(manifest, takes)
    if layers[-1][0].shape[0] != gives:
        raise wrong_output(layers[-1][0].shape[0], manifest)


def _misshapen(index: int, why: str) -> UnfitError:
    return UnfitError(why, part=f"layer {index} of policy.pth", slug="weights-malformed")


def _bins(settings: Settings) -> int | None:
    """How many bins each joint has; None where the actions are numbers.

    Raises:
        UnfitError: not nine joints with the same number of bins.
    """
    if settings.bins is None:
        return None
    counts = set(settings.bins)
    if len(settings.bins) != ACTION_SIZE or len(counts) != 1 or not 2 <= settings.bins[0] <= MOST_BINS:
        raise UnfitError(
            f"its action space has {list(settings.bins[:20])} bins, not {ACTION_SIZE} times the same number of 2 to {MOST_BINS}",
            part="entry data, action_space",
            slug="action-does-not-fit",
        )
    return settings.bins[0]


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
