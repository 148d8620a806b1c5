"""stable-baselines3 archives with their ``VecNormalize`` pickle, with the library or, where it is missing, by their keys."""

import io
import json
import pickle
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from api_schemas.policy import ACTION_SIZE, PolicyManifest
from api_schemas.policy_network import ActionHead
from client_cli.packing.checkpoints import arrays, parts_of
from client_cli.packing.original import Stack, scaled_as_stated
from client_cli.packing.quiet import first_sentence, quiet
from client_cli.packing.recipe import Array, Normaliser, Part, Recipe, clipped_to
from client_cli.terminal.errors import UsageProblem

ACTORS = {
    "mlp_extractor.policy_net": ("lstm_actor", "mlp_extractor.policy_net.", "action_net"),
    "actor.latent_pi": ("", "actor.latent_pi.", "actor.mu"),
    "actor.mu.0": ("", "actor.mu.", ""),
}
"""By a key of ``policy.pth``: the actor's memory, its layers, its last layer. PPO and A2C; SAC; TD3 and DDPG."""
NAMES_OF_ACTIVATIONS = {"ELU": "elu", "ReLU": "relu", "Tanh": "tanh"}


@dataclass(frozen=True)
class Archive:
    """An archive read: what is in it, and what was left of ``VecNormalize``.

    ``policy`` is the library's own, where it could be made; ``why_not`` says why it could not.
    """

    state: Mapping[str, Array]
    data: dict[str, Any]
    statistics: Any
    policy: Any
    why_not: str | None


def read(path: Path, pickled: Path | None, *, with_library: bool = True) -> Archive:
    """Reads an archive and the pickle beside it.

    Raises:
        UsageProblem: it is none.
    """
    import torch

    try:
        with zipfile.ZipFile(path) as archive:
            loaded = torch.load(io.BytesIO(archive.read("policy.pth")), map_location="cpu", weights_only=True)
            data = json.loads(archive.read("data"))
    except Exception as error:
        raise UsageProblem(f"{path.name} is a damaged archive of stable-baselines3: {first_sentence(error)}") from error
    policy, why_not = _rebuilt(path, loaded) if with_library else (None, "not asked for")
    return Archive(arrays(loaded), data, None if pickled is None else _unpickled(pickled), policy, why_not)


def _rebuilt(path: Path, state: Any) -> tuple[Any, str | None]:
    """The library's own policy with these weights, or None and why not."""
    try:
        with quiet():
            return _library_policy(path, state), None
    except Exception as error:  # no library, another version, a class of the user's that is not here
        return None, first_sentence(error)


def _library_policy(path: Path, state: Any) -> Any:
    from stable_baselines3.common.save_util import load_from_zip_file

    data, _, _ = load_from_zip_file(path, device="cpu")
    assert data is not None, "read without data"
    kwargs = dict(data["policy_kwargs"])
    if any(name.startswith("mlp_extractor") for name in state):
        kwargs.setdefault("use_sde", data.get("use_sde", False))
    policy = data["policy_class"](data["observation_space"], data["action_space"], lambda _: 0.0, **kwargs)
    policy.load_state_dict(state)
    policy.set_training_mode(False)
    return policy


class _Anything:
    """Stands for an object whose class is not installed; keeps its attributes."""

    def __init__(self, *_arguments: object, **_named: object) -> None: ...

    def __setstate__(self, state: object) -> None:
        if isinstance(state, dict):
            self.__dict__.update(state)


class _Tolerant(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        try:
            return super().find_class(module, name)
        except (ImportError, AttributeError):
            return _Anything


def _unpickled(path: Path) -> Any:
    with path.open("rb") as file:
        return _Tolerant(file).load()


def recipe_of(archive: Archive, architecture_activation: str | None) -> Recipe:
    """What the archive holds, as parts.

    Raises:
        UsageProblem: its policy is of a kind that cannot be packed.
    """
    key = next((each for each in ACTORS if any(name.startswith(each) for name in archive.state)), None)
    if key is None or any("features_extractor" in name for name in archive.state):
        raise UsageProblem("the archive has no MlpPolicy: its actor is none of PPO, A2C, RecurrentPPO, SAC, TD3 and DDPG")
    if archive.data.get("use_sde"):
        raise UsageProblem("policies with gSDE (use_sde=True) are not packed; export the deterministic actor to TorchScript")
    memory, layers, last = ACTORS[key]
    known = parts_of(archive.state)
    names = [memory, *(name for name in known if name.startswith(layers)), last]
    parts = tuple(known[name] for name in names if name in known)
    activation = architecture_activation or _activation(archive, "tanh" if memory else "relu")
    return _with_actions(Recipe("stable-baselines3", parts, _normaliser(archive.statistics), activation), archive, parts, memory)


def _activation(archive: Archive, usual: str) -> str:
    stated = archive.data.get("policy_kwargs", {})
    if archive.policy is not None:
        name = getattr(archive.policy, "activation_fn", None)
        name = getattr(name, "__name__", None)
    else:
        name = (re.findall(r"activation\.(\w+)", str(stated)) or [None])[0]
    if name is None:
        return usual
    if name not in NAMES_OF_ACTIVATIONS:
        raise UsageProblem(f"the activation {name} is not known to the farm; choose from {', '.join(NAMES_OF_ACTIVATIONS)}")
    return NAMES_OF_ACTIVATIONS[name]


def _normaliser(statistics: Any) -> Normaliser | None:
    if statistics is None or not getattr(statistics, "norm_obs", True):
        return None
    return Normaliser(statistics.obs_rms.mean, statistics.obs_rms.var, statistics.epsilon, float(statistics.clip_obs))


def _with_actions(recipe: Recipe, archive: Archive, parts: tuple[Part, ...], on_policy: str) -> Recipe:
    """What the library makes of the network's output: bins, a clip to the action space, or a squash into it."""
    from dataclasses import replace

    space = archive.data["action_space"]
    if "nvec" in space:
        if np.ptp(_numbers(space["nvec"])):
            raise UsageProblem(f"the actuators have {space['nvec']} bins; all must have the same number")
        return replace(recipe, head=ActionHead.BINS, bins=parts[-1].gives // ACTION_SIZE)
    low, high = (_numbers(space[name]) for name in ("low", "high"))
    if on_policy:
        return clipped_to(recipe, low, high)
    return replace(recipe, squash="tanh", factor=(high - low) / 2, shift=(high + low) / 2 if (high + low).any() else None)


def bounds_of(space: Any) -> tuple[Array, Array] | None:
    """The bounds of a continuous action space as an archive's settings print it, None where they do not."""
    if not isinstance(space, Mapping) or not {"low", "high"} <= set(space):
        return None
    return _numbers(space["low"]), _numbers(space["high"])


def _numbers(text: Any) -> Array:
    """The numbers of a bound as the archive prints it, or of the bound itself."""
    found = re.findall(r"-?(?:inf|\d+\.?\d*(?:e[+-]?\d+)?)", str(text))
    values = np.array([float(each) for each in found])
    if values.shape != (ACTION_SIZE,):
        raise UsageProblem(f"the action space has the bounds {text}; an action has {ACTION_SIZE} numbers")
    return values


class LibraryOriginal:
    """The library's own ``predict``, deterministic, in units of the action space, times the user's scale."""

    def __init__(self, archive: Archive, wanted: PolicyManifest, scale: float | None) -> None:
        self._archive, self._scaling = archive, wanted.input_scaling
        unit = wanted.output_scaling.scale if scale is None else scale
        self._scale = np.asarray(1.0 if unit is None else unit)
        self._offset = np.asarray(wanted.output_scaling.offset or 0.0)
        self._stack = Stack(wanted)
        self._memory: Any = None

    def begin(self) -> None:
        """Begin a trial."""
        self._stack.begin()
        self._memory = None

    def act(self, observation: Array) -> Array:
        """The action (9,), in N m or rad, for an observation (n,)."""
        statistics = self._archive.statistics
        if _normaliser(statistics) is None:
            row = self._stack(scaled_as_stated(observation, self._scaling))
        elif statistics.obs_rms.mean.size == observation.size:
            row = self._stack(statistics.normalize_obs(observation))
        else:
            row = statistics.normalize_obs(self._stack(observation))
        # A recurrent policy begins with zeros where it is given nothing; the others hand back what they were given.
        action, self._memory = self._archive.policy.predict(row.astype(np.float32), self._memory, deterministic=True)
        return self._finished(action)

    def batch(self, observations: Array) -> Array | None:
        """Actions (k, 9) for observations (k, n) in one call; None for a policy with memory or a stack of observations."""
        if hasattr(self._archive.policy, "lstm_actor") or self._stack.counts:
            return None
        statistics = self._archive.statistics
        rows = np.stack([scaled_as_stated(row, self._scaling) for row in observations])
        rows = rows if _normaliser(statistics) is None else statistics.normalize_obs(rows)
        return self._finished(self._archive.policy.predict(rows.astype(np.float32), deterministic=True)[0])

    def _finished(self, action: Array) -> Array:
        space = self._archive.policy.action_space
        if hasattr(space, "nvec"):
            action = action * 2 / (space.nvec - 1) - 1
        return action.astype(np.float64) * self._scale + self._offset
