"""What is installed: no library older than those that the tests ran with, and one line for each."""

import re
import tomllib
from itertools import chain

from packaging.requirements import Requirement
from packaging.version import Version

from tests import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PINS = [line.split("==") for line in (ROOT / "constraints.txt").read_text().split() if "==" in line]


def plain(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def test_a_constraint_stands_once():
    names = [plain(name) for name, _ in PINS]
    assert sorted(set(names)) == sorted(names)


def test_every_library_that_programs_need_has_a_floor_that_was_tried():
    """Of those for development make sees to it, by the constraints."""
    pins = {plain(name): Version(version) for name, version in PINS}
    extras = chain.from_iterable(needs for extra, needs in PROJECT["optional-dependencies"].items() if extra != "dev")
    for needed in map(Requirement, [*PROJECT["dependencies"], *extras]):
        floors = [each for each in needed.specifier if each.operator in {">=", "=="}]
        assert len(floors) == 1, f"{needed} has no lower bound"
        assert Version(floors[0].version) <= pins.get(plain(needed.name), Version(floors[0].version)), needed
