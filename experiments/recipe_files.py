"""A training's recipe as the file that the training program reads, with what lies beside it: ranges and demonstrations."""

import hashlib
import tomllib
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any

from experiments.design import Demonstrations, Start, Training
from sim_backend.effects.ranges import __file__ as _ranges_file
from sim_backend.effects.ranges import load_ranges
from sim_backend.training.changes import changes
from sim_backend.training.demonstrations.recipe import ImitationRecipe
from sim_backend.training.recipe import Recipe, RecipeError, load_recipe, schema_of

REAL = Path(_ranges_file).parent / "presets" / "real.toml"
REDUCED = "reduced-real.toml"


def write_recipe(
    training: Training, seed: int, folder: Path, name: str, demonstrations: Path | None = None, begun_with: Path | None = None
) -> Path:
    """Write the recipe of a run, and the reduced ranges that it names; gives its path.

    ``begun_with`` is the folder of the training's start.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if training.without:
        reduced = folder / REDUCED
        reduced.write_text(toml_of(reduced_real(training.without)))
        load_ranges(reduced)
    beside = (None if each is None else str(each.absolute()) for each in (demonstrations, begun_with))
    path = folder / f"{name}.toml"
    path.write_text(toml_of(_document(training, seed, *beside)))
    return path


def wanted_recipe(training: Training, seed: int) -> Recipe | ImitationRecipe:
    """The recipe of a run as the training program understands it; files and folders by their names alone."""
    shown, start = training.demonstrations, training.start
    begun_with = None if start is None else start_name(start.of(seed))
    document = _document(training, seed, None if shown is None else demonstrations_name(shown), begun_with)
    return schema_of(document).model_validate(document)


def _document(training: Training, seed: int, demonstrations: str | None, begun_with: str | None) -> dict[str, Any]:
    recipe: dict[str, Any] = {**training.recipe, "seed": seed}
    if training.without:
        recipe["physics"] = REDUCED
    if demonstrations is not None:
        recipe["demonstrations"] = dict(recipe["demonstrations"]) | {"files": [demonstrations]}
    if begun_with is not None:
        recipe["warm_start"] = {"run": begun_with}
    return recipe


def changes_since(folder: Path, name: str, training: Training, seed: int) -> list[str]:
    """What a run is to be trained by otherwise than the recipe that was written for it says; nothing where there is none."""
    path, reduced = folder / f"{name}.toml", folder / REDUCED
    if not path.exists():
        return []
    try:
        before = load_recipe(str(path))[1].model_dump(mode="json")
    except RecipeError as error:
        return [f"its recipe does not hold any more ({error})"]
    found = changes(before, wanted_recipe(training, seed), ("about", "checkpoint_minutes"))
    if training.without and reduced.exists() and tomllib.loads(reduced.read_text()) != reduced_real(training.without):
        found.append(f"{REDUCED} has other ranges")
    return found


def start_document(start: Start) -> dict[str, Any]:
    """The recipe of a start, with its seed."""
    return {**start.recipe, "seed": start.seed}


def start_name(start: Start) -> str:
    """Of its folder; another recipe has another one."""
    return f"{start.name}-{_digest(toml_of(start_document(start)))}"


def demonstrations_name(shown: Demonstrations) -> str:
    """Of the file."""
    return f"{shown.policy}-{shown.count}.demonstrations"


def demonstrations_folder(shown: Demonstrations) -> str:
    """Name of the folder of all demonstrations that were recorded in this way, however many."""
    return f"{shown.policy}-{_digest(f'{shown.task} {shown.physics} {shown.noise!r}')}"


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def reduced_real(without: tuple[str, ...]) -> dict[str, Any]:
    """The ranges ``real`` without those of some effects.

    Raises:
        ValueError: an effect that ``real`` does not have.
    """
    document = tomllib.loads(REAL.read_text())
    there = {row["key"].partition(".")[0] for row in document["range"]}
    if missing := sorted(set(without) - there):
        raise ValueError(f"real has no ranges of {', '.join(missing)}; choose from {', '.join(sorted(there))}")
    rows = [row for row in document["range"] if row["key"].partition(".")[0] not in without]
    return document | {"range": rows}


def recording_arguments(shown: Demonstrations, out: Path) -> list[str]:
    """For the program that records; it tries more goals than are needed, since only successes are kept."""
    tried = shown.count + shown.count // 2 + 10
    settings = ["--task", shown.task, "--trials", str(tried), "--physics", shown.physics, "--noise", str(shown.noise)]
    return [shown.policy, *settings, "--out", str(out)]


def cut(recorded: Path, count: int, out: Path) -> None:
    """Write the first ``count`` of the recorded trials.

    Raises:
        ValueError: there are not so many.
    """
    from sim_backend.training.demonstrations.recording import read_demonstrations, write_demonstrations  # they load torch

    found = read_demonstrations(recorded)
    if len(found.first) < count:
        raise ValueError(f"{recorded.name} has {len(found.first)} successful trials, {count} are needed")
    end = len(found.observation) if len(found.first) == count else int(found.first[count])
    kept = type(found)(found.observation[:end], found.action[:end], found.first[:count], found.manifest, found.tried)
    write_demonstrations(kept, out, {"cut_from": recorded.name, "count": count})


def toml_of(document: Mapping[str, Any]) -> str:
    """A document as TOML: tables, lists of tables, lists, texts, numbers, truth values and dates."""
    return "\n".join(_lines(document, "")) + "\n"


def _lines(table: Mapping[str, Any], name: str) -> list[str]:
    plain = {key: value for key, value in table.items() if not _is_table(value) and not _is_tables(value)}
    lines = [f"{key} = {_value(value)}" for key, value in plain.items()]
    for key, value in table.items():
        inner = f"{name}.{key}" if name else key
        if _is_table(value):
            lines += ["", f"[{inner}]", *_lines(value, inner)]
        elif _is_tables(value):
            for each in value:
                lines += ["", f"[[{inner}]]", *_lines(each, inner)]
    return lines


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _is_tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and len(value) > 0 and all(isinstance(each, Mapping) for each in value)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(each) for each in value)}]"
    text = str(value).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{text}"'
