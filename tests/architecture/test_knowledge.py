"""Who may name an effect in the reality gap: what is known of it, and the laws."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.excitations.excitation import EXCITATIONS

GAP = Path(__file__).parents[2] / "sim_backend" / "reality_gap"
LAWS = {
    "model/extended_laws.py",
    "model/native_laws.py",
    "subjects/joints/laws/body_law.py",
    "subjects/joints/rollouts/forward.py",
    "subjects/joints/laws/motor_law.py",
    "subjects/joints/torques/sent_torque.py",
    "subjects/tosses/models.py",
}
FILES = {path.relative_to(GAP).as_posix(): path for path in GAP.rglob("*.py")}


def names_in(text: str) -> Iterator[str]:
    """Effects that string constants name, alone or with a parameter; docstrings say what they like."""
    tree = ast.parse(text)
    said = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said:
            effect, _, parameter = node.value.partition(".")
            if effect in CATALOGUE and (parameter or effect not in EXCITATIONS):
                yield effect


def test_a_name_is_found_with_and_without_its_parameter_but_not_in_a_docstring():
    assert list(
        names_in('"""backlash"""\nx = ["backlash", "gravity.offset_m_s2", "joint_limits", "joint_limits.upper_rad"]')
    ) == [
        "backlash",
        "gravity",
        "joint_limits",
    ]


@pytest.mark.parametrize("name", sorted(set(FILES) - LAWS))
def test_only_knowledge_and_laws_name_effects(name):
    found = set(names_in(FILES[name].read_text(encoding="utf-8")))
    assert name.startswith("knowledge/") or not found, f"{name} names {', '.join(sorted(found))}"


@pytest.mark.parametrize("name", sorted(LAWS))
def test_laws_are_of_some_effect(name):
    assert list(names_in(FILES[name].read_text(encoding="utf-8")))


def test_no_public_class_has_the_name_of_another():
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in FILES.values()]
    names = Counter(node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef))
    assert [name for name, count in names.items() if count > 1 and not name.startswith("_")] == []
