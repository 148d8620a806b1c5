"""What a recipe says otherwise than the settings that a run was begun with: such a run is not gone on with."""

from collections.abc import Collection, Mapping
from pathlib import PurePosixPath
from typing import Any

from sim_backend.training.recipe import Table

MAY_CHANGE = ("about", "samples", "minutes", "checkpoint_minutes", "evaluation")
"""How long a run takes, how often it is kept and tried: nothing by which a sample is learned from otherwise."""


def changes(before: Mapping[str, Any], recipe: Table, leaving_out: Collection[str] = ()) -> list[str]:
    """What a recipe says otherwise, a phrase for each entry, such as ``reward.goal was 1.0 and is 2.0``.

    Files and folders are compared by their names alone, since where they lie differs from machine to machine. An entry that the
    settings do not have, being of an older version, counts only where the recipe names it.

    Args:
        before: settings as a record or a checkpoint keeps them.
        recipe: what is asked for now.
        leaving_out: entries that may differ.
    """
    now, named = (recipe.model_dump(mode="json", exclude_unset=unset) for unset in (False, True))
    return [
        f"{name} was {_shown(then)} and is {_shown(value)}"
        for name, then, value in _differences(before, now, named)
        if name.partition(".")[0] not in leaving_out
    ]


def _differences(before: Mapping[str, Any], now: Mapping[str, Any], named: Any, of: str = ""):
    for key, value in now.items():
        if key not in before:
            if isinstance(named, Mapping) and key in named:
                yield of + key, None, value
            continue
        then = before[key]
        if isinstance(then, Mapping) and isinstance(value, Mapping):
            yield from _differences(then, value, named.get(key) if isinstance(named, Mapping) else None, f"{of}{key}.")
        elif _without_folders(then) != _without_folders(value):
            yield of + key, then, value


def _without_folders(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _without_folders(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_without_folders(part) for part in value]
    return PurePosixPath(value).name if isinstance(value, str) and "/" in value else value


def _shown(value: Any) -> str:
    return "not there" if value is None else repr(_without_folders(value))
