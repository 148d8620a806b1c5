"""Where code stands: functions that fit on a screen, and tests at the path of what they test."""

import ast
import tomllib
from itertools import chain

import pytest

from tests import ROOT

LONGEST_BODY = 60
"""Lines, without signature and docstring."""
PACKAGES = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["root_packages"]
OF_THE_TESTS = {"benchmarks", "second_generator"}
"""Folders below ``tests/unit`` that test other tests."""


def bodies():
    """Every function with the number of lines of its body: (place, name, lines)."""
    for path in chain.from_iterable((ROOT / package).rglob("*.py") for package in PACKAGES):
        if "migrations" not in path.parts:
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                    first = node.body[1 if ast.get_docstring(node) and len(node.body) > 1 else 0]
                    yield path.relative_to(ROOT), node.name, node.body[-1].end_lineno - first.lineno + 1


def test_no_function_is_longer_than_a_screen():
    assert [found for found in bodies() if found[2] > LONGEST_BODY] == []


@pytest.mark.parametrize("package", PACKAGES)
def test_unit_tests_stand_at_the_path_of_what_they_test(package):
    for folder in (ROOT / "tests/unit" / package).rglob("*/"):
        if any(folder.glob("test_*.py")):
            assert (ROOT / folder.relative_to(ROOT / "tests/unit")).is_dir(), f"{folder} tests a package that does not exist"


def test_every_folder_of_unit_tests_is_one_of_a_package():
    folders = {path.name for path in (ROOT / "tests/unit").iterdir() if (path / "__init__.py").is_file()}
    assert folders - OF_THE_TESTS <= set(PACKAGES)


def test_the_map_of_the_readme_names_every_room_of_the_simulation():
    (row,) = [line for line in (ROOT / "README.md").read_text().splitlines() if line.startswith("| `sim_backend` |")]
    rooms = {path.parent.name for path in (ROOT / "sim_backend").glob("*/__init__.py")}
    assert {room for room in rooms if f"`{room}`" not in row} == set()
