"""Whether what is kept is of this design: results of another recipe, policy or farm do not count, and do not mix."""

from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from typing import Any

from api_schemas.builtin_policies import builtin_digest
from client_cli.policies.policy_files import read_policy
from experiments.catalogue import CATALOGUE
from experiments.design import BUILTIN, Cell, Experiment, Training
from experiments.recipe_files import wanted_recipe
from sim_backend.training import reference_policies
from sim_backend.training.changes import changes

UNIMPORTANT = ("about", "checkpoint_minutes")


def of_run(kept: Mapping[str, Any], cell: Cell, seed: int) -> list[str]:
    """What a finished training was trained by otherwise than its cell says, a phrase each."""
    if (training := training_of(cell)) is None:
        return []
    found = changes(kept["settings"], wanted_recipe(training, seed), UNIMPORTANT)
    return found + _other(kept, made_with(training))


def of_trials(kept: Mapping[str, Any], experiment: Experiment, cell: Cell, physics: str, policy: str | None) -> list[str]:
    """What farm trials were made with otherwise than is asked for; ``policy`` is the digest of what is to be tried, if known."""
    trials = experiment.trials
    if trials is None:
        return []
    found = _other(kept, asked_of_trials(experiment, cell, physics) | ({} if policy is None else {"policy_digest": policy}))
    if lengths := {len(rows) for rows in kept["blocks"].values()} - {trials.block}:
        found.append(f"trials of a block were {min(lengths)} and are {trials.block}")
    return found


def of_measured(kept: Mapping[str, Any], experiment: Experiment, cell: Cell, physics: str, policy: str | None) -> list[str]:
    """What was measured in simulation otherwise than is asked for."""
    asked = asked_of_measurements(experiment, cell, physics) | ({} if policy is None else {"policy_digest": policy})
    return _other(kept, asked)


def made_with(training: Training) -> dict[str, Any]:
    """What a training takes that its recipe only names; kept with its result."""
    shown = training.demonstrations
    return {"without": sorted(training.without), "demonstrated": None if shown is None else asdict(shown)}


def asked_of_trials(experiment: Experiment, cell: Cell, physics: str) -> dict[str, Any]:
    """What is asked of a cell's trials on one farm; kept with their result."""
    trials = experiment.trials
    assert trials is not None
    farms = [asdict(farm) for farm in trials.farms if farm.physics == physics]
    asked: dict[str, Any] = {"task": cell.task or trials.task, "object": cell.object, "object_scale": cell.object_scale}
    return asked | {"first_job_seed": trials.seed} | ({"farm": farms[0]} if farms else {})


def asked_of_measurements(experiment: Experiment, cell: Cell, physics: str) -> dict[str, Any]:
    """What is asked of a cell's measurement; kept with its result."""
    asked: dict[str, Any] = {}
    if (many := experiment.many_goals) is not None:
        asked = {"task": cell.task or "push", "physics": physics, "asked": _without(asdict(many), "physics")}
        asked |= {"first_seed": many.first_seed, "trials": many.trials}
    if (hidden := experiment.hidden) is not None:
        asked |= {"robots": hidden.robots, "asked": _without(asdict(hidden), "cells")}
    return asked


def training_of(cell: Cell) -> Training | None:
    """How a cell's policy comes about, be it that of another experiment's run."""
    if cell.runs_of is None:
        return cell.training
    return CATALOGUE[cell.runs_of].cell(cell.runs_of_cell or cell.name).training


@cache
def shipped_digest(policy: str) -> str:
    """The digest of a policy that comes with the project or with the farm."""
    if policy.startswith(BUILTIN):
        return builtin_digest(policy.removeprefix(BUILTIN))
    return read_policy(reference_policies.folder() / f"{policy}.safetensors", None, None).digest


def _other(kept: Mapping[str, Any], asked: Mapping[str, Any]) -> list[str]:
    """Where both say something and not the same; what is kept in an older form says less."""
    pairs = [(name, kept[name], _as_json(value)) for name, value in asked.items() if name in kept]
    return [phrase for name, then, now in pairs for phrase in _phrases(name, then, now)]


def _phrases(name: str, then: Any, now: Any) -> list[str]:
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        return [each for key in now if key in then for each in _phrases(f"{name}.{key}", then[key], now[key])]
    return [] if then == now else [f"{name} was {then!r} and is {now!r}"]


def _as_json(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _as_json(part) for name, part in value.items()}
    return [_as_json(part) for part in value] if isinstance(value, list | tuple) else value


def _without(table: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in table.items() if key != name}
