"""Archives of stable-baselines2, read without TensorFlow: ``parameters`` are numpy arrays, ``parameter_list`` names them."""

import io
import json
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from client_cli.packing.checkpoints import parts_of
from client_cli.packing.recipe import Array, Part, Recipe, clipped_to, follows
from client_cli.packing.stable_baselines import bounds_of
from client_cli.terminal.errors import UsageProblem

WEIGHTS = {"w:0": "weight", "kernel:0": "weight", "b:0": "bias", "bias:0": "bias"}
ON_POLICY = re.compile(r"model/(shared_fc\d+|pi_fc\d+|pi)")
OFF_POLICY = re.compile(r"model/pi/(fc\d+|dense)")
"""Actors of MlpPolicy: PPO2, A2C, ACKTR, TRPO; SAC, TD3, DDPG."""


def tensors_of(path: Path) -> tuple[dict[str, Array], Mapping[str, Any]]:
    """The archive's arrays as torch would name and turn them, and its plain settings.

    Raises:
        UsageProblem: it is damaged.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            names = json.loads(archive.read("parameter_list"))
            arrays = np.load(io.BytesIO(archive.read("parameters")), allow_pickle=False)
            data = json.loads(archive.read("data")) if "data" in archive.namelist() else {}
            return {_renamed(name): _turned(name, arrays[name]) for name in names}, data
    except (ValueError, KeyError, OSError) as error:
        raise UsageProblem(f"{path.name} is a damaged archive of stable-baselines2: {str(error)[:150]}") from error


def _renamed(name: str) -> str:
    module, _, last = name.rpartition("/")
    return f"{module}.{WEIGHTS[last]}" if last in WEIGHTS else name


def _turned(name: str, values: Array) -> Array:
    return values.T.copy() if values.ndim == 2 and name.endswith(("w:0", "kernel:0")) else values


def recipe_of(tensors: dict[str, Array], data: Mapping[str, Any], activation: str | None, takes: int) -> Recipe | None:
    """The actor of an MlpPolicy, or None where it is another policy, whose modules the user must name.

    Raises:
        UsageProblem: the activation was set in the training and cannot be read.
    """
    known = parts_of(tensors)
    on_policy = [each for name, each in known.items() if ON_POLICY.fullmatch(name)]
    off_policy = [each for name, each in known.items() if OFF_POLICY.fullmatch(name)]
    parts = off_policy or on_policy
    if not parts or not follows(parts, takes):
        return None
    if activation is None and "act_fun" in (data.get("policy_kwargs") or {}):
        raise UsageProblem("the archive has an act_fun of its own, which only TensorFlow can read: give --activation")
    return _off(parts, data, activation) if off_policy else _on(parts, data, activation)


def _on(parts: list[Part], data: Mapping[str, Any], activation: str | None) -> Recipe:
    bounds = bounds_of(data.get("action_space"))
    recipe = Recipe("stable-baselines2", tuple(parts), activation=activation or "tanh")
    return recipe if bounds is None else clipped_to(recipe, *bounds)


def _off(parts: list[Part], data: Mapping[str, Any], activation: str | None) -> Recipe:
    bounds = bounds_of(data.get("action_space"))
    low, high = bounds if bounds is not None else (-np.ones(9), np.ones(9))
    shift = (high + low) / 2
    return Recipe(
        *("stable-baselines2", tuple(parts)),
        activation=activation or "relu",
        squash="tanh",
        factor=(high - low) / 2,
        shift=shift if shift.any() else None,
    )
