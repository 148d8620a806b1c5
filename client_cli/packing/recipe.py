"""A network as its parts in the order in which they are applied, and the safetensors and manifest that they become."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from api_schemas.policy import ACTION_SIZE, ActionKind, InputScaling, OutputScaling, PolicyManifest
from api_schemas.policy_network import ActionHead, Cell
from client_cli.terminal.errors import UsageProblem

Array = np.ndarray
TINY = 1e-20
"""Epsilon where a library adds its own to the deviation: what is left under the root is the whole of it."""
GATES = {4: "lstm", 3: "gru"}
RECURRENT = ("lstm", "gru")


@dataclass(frozen=True)
class Part:
    """A module of torch: its name in the file, its kind, and its tensors by the names that torch gives them."""

    name: str
    kind: Literal["linear", "lstm", "gru", "norm"]
    tensors: Mapping[str, Array]

    @property
    def takes(self) -> int:
        """Numbers that it takes."""
        return self.tensors["weight_ih_l0" if self.kind in RECURRENT else "weight"].shape[-1]

    @property
    def gives(self) -> int:
        """Numbers that it gives."""
        return self.tensors["weight_hh_l0"].shape[1] if self.kind in RECURRENT else self.tensors["weight"].shape[0]


@dataclass(frozen=True)
class Normaliser:
    """Running statistics of observations, shape (n,) each.

    (x - mean) / sqrt(variance + epsilon), or with ``outside`` (x - mean) / (sqrt(variance) + epsilon); then a clip to ±clip.
    """

    mean: Array
    variance: Array
    epsilon: float
    clip: float | None
    outside: bool = False


@dataclass(frozen=True)
class Recipe:
    """What was found in a checkpoint: action = factor · clip(squash(head(network(normalised)))) + shift."""

    source: str
    parts: tuple[Part, ...]
    normaliser: Normaliser | None = None
    activation: str | None = None
    head: ActionHead = ActionHead.DIRECT
    bins: int | None = None
    squash: Literal["tanh"] | None = None
    clip: float | None = None
    factor: Array | None = None
    shift: Array | None = None
    clips: bool = True
    """Whether the manifest's clip of outputs applies; not where outputs are in units of a normaliser of the file."""
    uses: tuple[str, ...] = ()
    """Tensors of the file that are used beside those of the parts."""


def part(name: str, tensors: Mapping[str, Array]) -> Part | None:
    """The part that a module's tensors make, or None where they make none that the farm knows."""
    if "weight_hh_l0" in tensors:
        across = tensors["weight_hh_l0"]
        kind = GATES.get(across.shape[0] // across.shape[1])
        if kind is None or any("reverse" in each or each.startswith("weight_hr") for each in tensors):
            return None
        return Part(name, "lstm" if kind == "lstm" else "gru", tensors)
    weight = tensors.get("weight")
    if weight is None or "bias" not in tensors or weight.ndim not in (1, 2) or len(tensors) != 2:
        return None
    return Part(name, "linear" if weight.ndim == 2 else "norm", tensors)


def follows(parts: Iterable[Part], takes: int) -> bool:
    """Whether each part takes what the one before gives, the first ``takes`` numbers."""
    for each in parts:
        if each.takes != takes:
            return False
        takes = each.gives
    return True


def clipped_to(recipe: Recipe, low: Array, high: Array) -> Recipe:
    """The recipe with its outputs clipped to the bounds of each joint, shape (9,) each.

    Bounds that differ, between joints or in size, become a clip to ±1: the last layer is divided by them, a factor and a shift
    multiply them again.

    Raises:
        UsageProblem: some of the bounds are infinite, or there is nothing between them.
    """
    if np.isinf(low).all() and np.isinf(high).all():
        return replace(recipe, clips=False)
    middle, half = (high + low) / 2, (high - low) / 2
    if not (np.isfinite(middle).all() and (half > 0).all()):
        raise UsageProblem(
            f"the action space is clipped to {low} … {high}; a policy is packed with finite bounds, or none at all"
        )
    if not np.ptp(half) and not middle.any():
        return replace(recipe, clip=float(half[0]))
    last = recipe.parts[-1]
    weight, bias = (last.tensors[name].astype(np.float64) for name in ("weight", "bias"))
    tensors = {"weight": weight / half[:, None], "bias": (bias - middle) / half}
    parts = (*recipe.parts[:-1], replace(last, tensors={name: each.astype(np.float32) for name, each in tensors.items()}))
    uses = (*recipe.uses, f"{last.name}.weight", f"{last.name}.bias")
    return replace(recipe, parts=parts, clip=1.0, factor=half, shift=middle if middle.any() else None, uses=uses)


def tensors_of(recipe: Recipe) -> dict[str, Array]:
    """The recipe's weights under the names of a safetensors policy.

    Raises:
        UsageProblem: the parts are in an order that such a file cannot say.
    """
    memory = [index for index, each in enumerate(recipe.parts) if each.kind in RECURRENT]
    first = memory[0] if memory else 0
    if len(memory) > 1:
        raise UsageProblem("the network has several recurrent modules; one, of any number of layers, can be packed")
    made: dict[str, Array] = {}
    counts = {"encoder": 0, "layer": 0}
    for index, each in enumerate(recipe.parts):
        if each.kind in RECURRENT:
            made |= {f"recurrent.{name}": values for name, values in each.tensors.items()}
            continue
        if each.kind == "norm":
            if not memory or index != first + 1:
                raise UsageProblem(f"{each.name} is a layer norm; one can be packed only right after a recurrent module")
            made |= {f"recurrent_norm.{name}": values for name, values in each.tensors.items()}
            continue
        kind = "encoder" if memory and index < first else "layer"
        made |= {f"{kind}{counts[kind]}.{name}": values for name, values in each.tensors.items()}
        counts[kind] += 1
    if not counts["layer"]:
        raise UsageProblem("the network must end in a linear layer")
    return made | _statistics(recipe.normaliser)


def _statistics(normaliser: Normaliser | None) -> dict[str, Array]:
    if normaliser is None:
        return {}
    variance = normaliser.variance.astype(np.float64)
    if normaliser.outside:
        variance = np.maximum((np.sqrt(variance) + normaliser.epsilon) ** 2 - TINY, 0)
    return {"running_mean": normaliser.mean.astype(np.float64), "running_var": variance}


def manifest_of(recipe: Recipe, wanted: PolicyManifest, scale: float | None, activation: str | None) -> PolicyManifest:
    """The user's manifest with what the checkpoint says in its place.

    Args:
        recipe: of the checkpoint.
        wanted: what the user says: observation, action kind, rate.
        scale: what an action of 1 is, in N m or rad; the manifest's own if None.
        activation: stated by the user.
    """
    memory = next((Cell(each.kind) for each in recipe.parts if each.kind in RECURRENT), None)
    return wanted.model_copy(
        update={
            "activation": activation or recipe.activation or wanted.activation,
            "recurrent": memory,
            "head": recipe.head if recipe.head is not ActionHead.DIRECT else wanted.head,
            "bins": recipe.bins if recipe.head is not ActionHead.DIRECT else wanted.bins,
            "input_scaling": _input_scaling(recipe.normaliser, wanted.input_scaling),
            "output_scaling": _output_scaling(recipe, wanted.output_scaling, scale),
        }
    )


def _input_scaling(normaliser: Normaliser | None, wanted: InputScaling) -> InputScaling:
    if normaliser is None:
        return wanted
    if wanted.low or wanted.mean:
        raise UsageProblem("the file brings its own normalisation of observations; leave low, high, mean and variance out")
    return InputScaling(epsilon=TINY if normaliser.outside else normaliser.epsilon, clip=normaliser.clip)


def _output_scaling(recipe: Recipe, wanted: OutputScaling, scale: float | None) -> OutputScaling:
    unit = wanted.scale if scale is None else scale
    shift = None
    if recipe.factor is not None or recipe.shift is not None:
        by = np.broadcast_to(1.0 if unit is None else np.asarray(unit), (ACTION_SIZE,))
        unit = tuple(float(each) for each in by * (1.0 if recipe.factor is None else recipe.factor))
        shift = None if recipe.shift is None else tuple(float(each) for each in by * recipe.shift)
    return OutputScaling(
        clip=wanted.clip if recipe.clip is None and recipe.squash is None and recipe.clips else recipe.clip,
        scale=unit,
        squash=recipe.squash or wanted.squash,
        offset=wanted.offset if shift is None else shift,
    )


def unit_of(manifest: PolicyManifest) -> str:
    """The unit of an action."""
    return "N m" if manifest.action_kind is ActionKind.TORQUE else "rad"
