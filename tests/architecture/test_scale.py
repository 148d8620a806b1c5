"""A test that ``make test`` leaves out names one that keeps its claim."""

import ast
import re

import pytest

from tests import ROOT


def functions(path):
    return [each for each in ast.walk(ast.parse(path.read_text())) if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)]


def marked(function, name="pytest.mark.scale"):
    """Whether it, or one of its parameters, has the mark."""
    return any(name in ast.unparse(each) for each in function.decorator_list)


def all_marked(function):
    return any(ast.unparse(each) == "pytest.mark.scale" for each in function.decorator_list)


FILES = sorted((ROOT / "tests").rglob("test_*.py"))
TESTS = {function.name: (path, function) for path in FILES for function in functions(path) if function.name.startswith("test_")}
SCALE = [name for name, (_, function) in TESTS.items() if marked(function)]


@pytest.mark.parametrize("name", SCALE)
def test_what_is_left_out_names_a_test_that_runs(name):
    _, function = TESTS[name]
    named = re.findall(r"`(test_\w+)`", ast.get_docstring(function) or "")
    assert named, f"{name} is marked scale: name the smaller test with its claim in the docstring, in backticks"
    for each in named:
        assert each in TESTS, f"{name} names {each}, which is no test"
        assert not all_marked(TESTS[each][1]), f"{name} names {each}, which make test leaves out, too"
