"""docs/problems.md lists every problem type that the services can answer with, and no other."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "problems.md").read_text()
TREES = [ast.parse(path.read_text()) for path in sorted((ROOT / "services").rglob("*.py"))]
NODES = [node for tree in TREES for node in ast.walk(tree)]
ANSWER, ANSWERS_TYPE_AT = "answer", 2
"""The function of services/api/problems.py, and which of its arguments is the type."""


def name_of(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def error_classes() -> set[str]:
    """ServiceError and whatever is made of it."""
    found: set[str] = {"ServiceError"}
    classes = [node for node in NODES if isinstance(node, ast.ClassDef)]
    while more := {each.name for each in classes if found & {name_of(base) for base in each.bases}} - found:
        found |= more
    return found


def types_in(node: ast.expr) -> Iterator[str]:
    """The constants that an argument can be; a part that is filled in later is any word."""
    if isinstance(node, ast.JoinedStr):
        yield "".join(str(part.value) if isinstance(part, ast.Constant) else "[a-z]+" for part in node.values)
    elif not isinstance(node, ast.Name):
        yield from (each.value for each in ast.walk(node) if isinstance(each, ast.Constant) and isinstance(each.value, str))


def given() -> set[str]:
    """Patterns of all types that are given somewhere: to an error, to an answer, or as ``slug``."""
    errors, found = error_classes(), set[str]()
    for node in NODES:
        if isinstance(node, ast.Call):
            place = 0 if name_of(node.func) in errors else ANSWERS_TYPE_AT if name_of(node.func) == ANSWER else None
            if place is not None and len(node.args) > place:
                found |= set(types_in(node.args[place]))
            for keyword in node.keywords:
                found |= set(types_in(keyword.value)) if keyword.arg == "slug" else set()
        elif isinstance(node, ast.Assign) and "slug" in {name_of(target) for target in node.targets}:
            found |= set(types_in(node.value))
    return found


def constants() -> set[str]:
    """Every text of the code; types also stand in tables."""
    return {node.value for node in NODES if isinstance(node, ast.Constant) and isinstance(node.value, str)}


LISTED = re.findall(r"^\|([^|]+)\|", PAGE, re.MULTILINE)
TYPES = [name for cell in LISTED for name in re.findall(r"`/problems/([a-z0-9-]+)`", cell)]


def test_every_type_that_is_given_is_listed():
    patterns = given()
    assert len(patterns) > 90
    assert not {pattern for pattern in patterns if not any(re.fullmatch(pattern, name) for name in TYPES)}


def test_no_other_type_is_listed_and_none_twice():
    filled_in = {pattern for pattern in given() if "[" in pattern}
    known = constants()
    assert not {name for name in TYPES if name not in known and not any(re.fullmatch(pattern, name) for pattern in filled_in)}
    assert sorted(set(TYPES)) == sorted(TYPES)
