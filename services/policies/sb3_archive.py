"""An archive of stable-baselines3: which entries it may have, and the few plain values that are read. Nothing is unpickled."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from services.policies.foreign import check_entries
from services.policies.torch_file import check_archive
from services.policies.unfit import UnfitError
from services.policies.zip_directory import STORED, Entry, inflate, read_directory

ENTRY_LIMIT = 64
DATA_LIMIT_BYTES = 8 * 1024 * 1024
PLAIN_TIMES = 2
"""How many times the limit of an upload all entries may have once inflated."""
WEIGHTS, SETTINGS = "policy.pth", "data"
UNUSED = re.compile(r"[a-z0-9_.]*optimizer\.pth|pytorch_variables\.pth|tensors\.pth|_stable_baselines3_version|system_info\.txt")
"""Entries that an archive has and that are never opened."""
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d{1,3})?")
MEAN_CLIP = 2.0
"""What stable-baselines3 takes where an archive says nothing."""
ACTIVATIONS = {
    "ELU": "Elu",
    "ReLU": "Relu",
    "Tanh": "Tanh",
    "LeakyReLU": "LeakyRelu",
    "Sigmoid": "Sigmoid",
    "Softplus": "Softplus",
}
"""torch's modules, with the operators that compute the same with the modules' defaults."""


@dataclass(frozen=True)
class Settings:
    """What the archive says of its policy in plain text; None where it says nothing."""

    activation: str | None
    squashed: bool
    low: tuple[float, ...] | None
    high: tuple[float, ...] | None
    mean_clip: float
    bins: tuple[int, ...] | None = None
    """Of a MultiDiscrete action space, for each actuator."""


def check_entries_of(content: memoryview, limit_bytes: int) -> dict[str, Entry]:
    """The entries of an archive, none of which has been inflated.

    Raises:
        UnfitError: it is not what stable-baselines3 writes, or something lies in it besides.
    """
    entries = read_directory(content, entry_limit=ENTRY_LIMIT, plain_limit_bytes=PLAIN_TIMES * limit_bytes)
    check_entries(entries)
    for name in entries:
        if name not in (WEIGHTS, SETTINGS) and not UNUSED.fullmatch(name):
            what = (
                "statistics of VecNormalize or another pickle" if name.endswith(("pkl", "pickle")) else "not of stable-baselines3"
            )
            raise UnfitError(f"it is {what}, and not taken", part=f"entry {name}", slug="archive-entry", pack=True)
    for name in (SETTINGS, WEIGHTS):
        if name not in entries:
            raise UnfitError(
                "the archive has no such entry, so that model.save() of stable-baselines3 did not write it",
                part=f"entry {name}",
                slug="archive-entry",
                pack=True,
            )
    for name, limit in ((SETTINGS, DATA_LIMIT_BYTES), (WEIGHTS, limit_bytes)):
        if entries[name].plain_bytes > limit:
            raise UnfitError(
                f"it has {entries[name].plain_bytes} bytes; at most {limit} are taken", part=f"entry {name}",
                slug="archive-too-large",
            )  # fmt: skip
    weights = entries[WEIGHTS]
    if weights.method == STORED:
        check_archive(content[weights.begin : weights.begin + weights.packed_bytes], limit_bytes)
    return entries


def read_settings(content: memoryview, entries: Mapping[str, Entry]) -> Settings:
    """The plain values of ``data``; what is pickled beside them is text that nobody reads.

    Raises:
        UnfitError: it is not JSON, or says something that a feed-forward policy does not have.
    """
    try:
        data = json.loads(bytes(inflate(content, entries[SETTINGS])))
    except (ValueError, RecursionError) as error:
        raise _unfit(f"it is not JSON ({str(error)[:100]})") from error
    if not isinstance(data, dict):
        raise _unfit("it is not a JSON object")
    arguments, space = _object(data, "policy_kwargs"), _object(data, "action_space")
    return Settings(
        _activation(arguments.get("activation_fn")),
        arguments.get("squash_output") is True,
        _bounds(space, "low"),
        _bounds(space, "high"),
        _mean_clip(arguments.get("clip_mean")),
        _bins(space),
    )


def _bins(space: Mapping[str, Any]) -> tuple[int, ...] | None:
    """The numbers of choices that a MultiDiscrete space prints; None for other spaces."""
    counts = _bounds(space, "nvec")
    return None if counts is None else tuple(int(each) for each in counts)


def _mean_clip(said: object) -> float:
    """Where gSDE clips the mean; 0 where it does not."""
    return float(said) if isinstance(said, int | float) and 0 <= said < 1e6 else MEAN_CLIP


def _object(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = data.get(name)
    return value if isinstance(value, dict) else {}


def _activation(said: object) -> str | None:
    """The operator of a text such as ``<class 'torch.nn.modules.activation.ELU'>``."""
    if said is None:
        return None
    name = str(said).rpartition(".")[2].rstrip("'>")
    if name not in ACTIVATIONS:
        choices = ", ".join(ACTIVATIONS)
        raise UnfitError(f"the activation {name!r:.60} is not taken; choose from {choices}", part="entry data", pack=True)
    return ACTIVATIONS[name]


def _bounds(space: Mapping[str, Any], name: str) -> tuple[float, ...] | None:
    """Numbers that numpy wrote as text, such as ``[-1. -1.]``; None where the text was cut or is missing."""
    text = space.get(name)
    if not isinstance(text, str) or len(text) > 10_000:
        return None
    words = text.strip().removeprefix("[").removesuffix("]").split()
    if not words or not all(NUMBER.fullmatch(word) for word in words):
        return None
    return tuple(float(word) for word in words)


def _unfit(reason: str) -> UnfitError:
    return UnfitError(reason, part="entry data", slug="archive-malformed", pack=True)
