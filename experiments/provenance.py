"""What results are made by: the content of the physics, and the code that trials are made of; two versions do not mix.

Both are told by content, of a clone without its history and of an installed package alike.
"""

import ast
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from api_schemas.physics import physics_name
from sim_backend.effects.ranges import load_ranges

DIGITS = 16
"""Of a digest; hexadecimal."""
PACKAGES = ("sim_backend", "robot_farm")
NOT_OF_A_TRIAL = ("reality_gap", "training")
"""Folders of the packages that no outcome of a trial depends on; policies that were trained have digests of their own."""
WORDS = ("source", "dated")
"""What a row of ranges says for people."""


@dataclass(frozen=True)
class Versions:
    """What made an experiment's results of one kind: so many parts, of which so many do not say what made them."""

    known: Mapping[str, str]
    parts: int
    unknown: int


def made_by(physics: str) -> dict[str, str]:
    """What a trial on robots of a physics is made by now: versions, and digests of the code and of the physics by its name."""
    versions = {"trifarm": version("trifarm"), "mujoco": version("mujoco-core")}
    return versions | {"code": _code_now(), f"physics {physics_name(physics)}": ranges_digest(physics)}


def trained_by() -> dict[str, str]:
    """What a training is made by now: versions, and the digest of all code of the simulation with that of training."""
    versions = {"trifarm": version("trifarm"), "mujoco": version("mujoco-core"), "torch": version("torch")}
    return versions | {"stable-baselines3": version("stable-baselines3"), "code": _code_now(("sim_backend",), ("reality_gap",))}


def differing(kept: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Where both say something and not the same, a phrase each."""
    return [f"{name} was {kept[name]} and is {now[name]}" for name in now if kept.get(name, now[name]) != now[name]]


def ranges_digest(physics: str) -> str:
    """The digest of what robots are drawn from: every row of the ranges in their order, and what all robots share.

    Raises:
        ValueError: there is no such physics.
    """
    ranges = load_ranges(physics)
    rows = [{name: value for name, value in asdict(row).items() if name not in WORDS} for row in ranges.rows]
    drawn = {"draws": ranges.estimate.draws, "intervals": [asdict(each) for each in ranges.estimate.intervals]}
    return _digest(json.dumps({"rows": rows, "shared": ranges.shared.document()} | drawn))


def code_digest(folders: Sequence[Path], but: Sequence[str] = NOT_OF_A_TRIAL) -> str:
    """The digest of all modules below some folders but those in ``but``, comments and docstrings left out."""
    files = [(path.relative_to(folder), path) for folder in folders for path in sorted(folder.rglob("*.py"))]
    counted = [(name.as_posix(), path.read_text(encoding="utf-8")) for name, path in files if name.parts[0] not in but]
    return _digest(json.dumps([[name, repr(_told(ast.parse(text)))] for name, text in counted]))


@cache
def _code_now(packages: tuple[str, ...] = PACKAGES, but: tuple[str, ...] = NOT_OF_A_TRIAL) -> str:
    """Of packages as they are installed, which are read and not imported."""
    found = [find_spec(package) for package in packages]
    return code_digest([Path(spec.origin).parent for spec in found if spec is not None and spec.origin is not None], but)


def _told(node: Any) -> Any:
    """A syntax tree as nested lists, without docstrings and without what is empty: newer Pythons have more that may be."""
    if isinstance(node, list):
        return [_told(each) for each in node]
    if not isinstance(node, ast.AST):
        return node
    fields = {name: value for name, value in ast.iter_fields(node) if value is not None and value != []}
    has_docstring = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
    if has_docstring and ast.get_docstring(node, clean=False) is not None:
        fields["body"] = fields["body"][1:]
    return [type(node).__name__, *([name, _told(value)] for name, value in fields.items())]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]
