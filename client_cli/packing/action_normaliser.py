"""Numbers of a file by which a network's outputs become actions: found by their names, used as stated, never left out unsaid."""

import re
from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from api_schemas.policy import ACTION_SIZE
from client_cli.packing.recipe import Array, Recipe
from client_cli.terminal.errors import UsageProblem

NONE = "none"
ALIKE = re.compile(
    r"unnormali[sz]e|denormali[sz]e"
    r"|(^|[._])act(ion)?s?[._]?(stats[._])?(mean|mu|std|sigma|var|scale|bias|offset|low|high|min|max|range|limits?|rms|norm)"
    r"|(^|[._])(mean|std|max|min)_actions?$|output_?(mean|std|scale|bias|norm)",
    re.IGNORECASE,
)
"""Names of what looks like a normaliser of actions."""
KINDS = {
    "mean-std": "x · STD + MEAN, given as MEAN,STD",
    "min-max": "(x + 1) / 2 · (MAX - MIN) + MIN, given as MIN,MAX",
    "scale-bias": "x · SCALE + BIAS, given as SCALE,BIAS",
    "tanh-scale-bias": "tanh(x) · SCALE + BIAS, given as SCALE,BIAS",
}


def look_alikes(names: Collection[str], tensors: Mapping[str, Array]) -> list[str]:
    """Those of the names that look like a normaliser of actions and hold one number or nine."""
    return [name for name in names if ALIKE.search(name) and tensors[name].size in (1, ACTION_SIZE)]


def check_has_none(names: Collection[str], tensors: Mapping[str, Array]) -> None:
    """Raises where a file holds what looks like a normaliser of actions, and nobody has said what it is.

    Raises:
        UsageProblem: names them, and says how to state it.
    """
    alike = look_alikes(names, tensors)
    if not alike:
        return
    kind = _likely(alike)
    others = ", ".join(each for each in KINDS if each != kind)
    raise UsageProblem(
        f"{', '.join(alike[:4])} look like a normaliser of the actions, and the file does not say how it is applied: give "
        f"--action-normaliser {kind}:{','.join(_ordered(kind, alike))} ({KINDS[kind]}; also {others}), "
        f"or --action-normaliser {NONE} if the network's outputs are actions as they are"
    )


def _likely(alike: list[str]) -> str:
    text = " ".join(alike).lower()
    if "scale" in text:
        return "tanh-scale-bias"
    return "min-max" if re.search(r"min|max|low|high", text) else "mean-std"


def _ordered(kind: str, alike: list[str]) -> list[str]:
    words = {"mean-std": ("mean", "std|var"), "min-max": ("min|low", "max|high")}.get(kind, ("scale", "bias|offset"))
    return [next((name for name in alike if re.search(word, name.lower())), word.partition("|")[0].upper()) for word in words]


def applied(recipe: Recipe, tensors: Mapping[str, Array], text: str) -> Recipe:
    """The recipe with the stated normaliser of actions after its network.

    Raises:
        UsageProblem: the statement fits nothing in the file.
    """
    if text == NONE:
        return recipe
    kind, _, names = text.partition(":")
    given = [each.strip() for each in names.split(",")]
    if kind not in KINDS or len(given) != 2:
        raise UsageProblem(f"--action-normaliser {text!r}: write KIND:NAME,NAME with a KIND of {', '.join(KINDS)}, or {NONE}")
    first, second = (_numbers(name, tensors) for name in given)
    used = replace(recipe, uses=(*recipe.uses, *given))
    if kind == "mean-std":
        return replace(used, factor=second, shift=first, clips=False)
    if kind == "min-max":
        return replace(used, factor=(second - first) / 2, shift=(second + first) / 2, clips=False)
    squash = "tanh" if kind.startswith("tanh") else recipe.squash
    return replace(used, factor=first, shift=second if second.any() else None, squash=squash)


def _numbers(name: str, tensors: Mapping[str, Array]) -> Array:
    values = tensors.get(name)
    if values is None or values.size not in (1, ACTION_SIZE):
        known = look_alikes(tensors, tensors)
        raise UsageProblem(
            f"--action-normaliser: the file has no {name!r} of {ACTION_SIZE} numbers; it has {', '.join(known) or 'none alike'}"
        )
    return np.broadcast_to(values.ravel().astype(np.float64), (ACTION_SIZE,))
