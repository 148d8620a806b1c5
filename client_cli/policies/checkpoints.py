"""A folder of checkpoints: which files are policies, and the number by which each differs from the others."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from api_schemas.ladder import MAX_RUNGS
from api_schemas.policy import WeightsFormat
from client_cli.terminal.errors import UsageProblem

NUMBER = re.compile(r"(\d+(?:\.\d+)?)(?:([kMG])(?![A-Za-z]))?")
"""A number in a file's name; k, M and G behind it count if no word begins with them."""
FACTORS = {None: 1.0, "k": 1e3, "M": 1e6, "G": 1e9}
SUFFIXES = tuple(f".{form}" for form in WeightsFormat)


@dataclass(frozen=True)
class Checkpoint:
    """A policy's file and its number."""

    file: Path
    step: float


def find_checkpoints(folder: Path, step_from: str | None = None) -> tuple[Checkpoint, ...]:
    """The policies of a folder by the number in their names: the one that ``step_from`` says, a word before it or a pattern.

    Where names have several numbers, it is the last one by which they differ: ``lift_2_final_100`` and ``lift_2_final_200``
    are 100 and 200, and so are ``seed1_step100_v2`` and ``seed1_step200_v2``.

    Raises:
        UsageProblem: there are none or too many, or one has no number.
    """
    files = sorted(path for path in folder.iterdir() if path.suffix in SUFFIXES and path.is_file())
    if not files:
        raise UsageProblem(f"{folder} holds no policy: no file in it ends in {', '.join(SUFFIXES)}")
    if len(files) > MAX_RUNGS:
        raise UsageProblem(f"{folder} holds {len(files)} policies; a ladder has at most {MAX_RUNGS}, so leave some out")
    if step_from is not None:
        return _in_order(Checkpoint(path, _stated(path, step_from)) for path in files)
    numbers = [_numbers(path) for path in files]
    without = [path.name for path, found in zip(files, numbers, strict=True) if not found]
    if without:
        raise UsageProblem(f"{without[0]} has no number in its name to place it on the ladder; rename it, or take it out")
    at = _telling(numbers)
    return _in_order(Checkpoint(path, found[at]) for path, found in zip(files, numbers, strict=True))


def _in_order(made: Iterable[Checkpoint]) -> tuple[Checkpoint, ...]:
    return tuple(sorted(made, key=lambda each: (each.step, each.file.name)))


def _stated(path: Path, step_from: str) -> float:
    """The number of a name that a word stands before, or that a pattern's group holds.

    Raises:
        UsageProblem: the name has no such number, or the pattern is none.
    """
    pattern = step_from if "(" in step_from else rf"{re.escape(step_from)}[^0-9]{{0,3}}(\d+(?:\.\d+)?[kMG]?)"
    try:
        found = re.search(pattern, path.stem)
        numbers = NUMBER.findall(found[1]) if found is not None else []
    except (re.error, IndexError) as error:
        raise UsageProblem(f"--step-from {step_from!r} is no pattern with one group, such as 'ep_(\\d+)': {error}") from error
    if not numbers:
        raise UsageProblem(f"--step-from {step_from!r}: {path.name} has no such number; rename it, or take it out")
    number, unit = numbers[0]
    return float(number) * FACTORS[unit or None]


def _numbers(path: Path) -> list[float]:
    return [float(number) * FACTORS[unit or None] for number, unit in NUMBER.findall(path.stem)]


def _telling(numbers: Sequence[list[float]]) -> int:
    """The place, counted from the end, of the last number that is not the same in all names; the last one if none is."""
    for at in range(-1, -min(len(found) for found in numbers) - 1, -1):
        if len({found[at] for found in numbers}) > 1:
            return at
    return -1
