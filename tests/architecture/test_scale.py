"""A test that ``make test`` leaves out names one that keeps its claim."""

import ast
import re

from tests import ROOT


def functions(path):
    return [each for each in ast.walk(ast.parse(path.read_text())) if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)]


def marked(function, name="pytest.mark.scale"):
    """Whether it, or one of its parameters, has the mark."""
    return any(name in ast.unparse(each) for each in function.decorator_list)


def all_marked(function):
    return any(ast.unparse(each) == "pytest.mark.scale" for each in function.decorator_list)


def test_what_is_left_out_names_a_test_that_runs():
    texts = {path: path.read_text() for path in sorted((ROOT / "tests").rglob("test_*.py"))}
    tests = {name: None for text in texts.values() for name in re.findall(r"def (test_\w+)", text)}
    for path in (path for path, text in texts.items() if "mark.scale" in text):
        tests |= {function.name: function for function in functions(path) if function.name.startswith("test_")}
    left_out = [name for name, function in tests.items() if function is not None and marked(function)]
    assert len(left_out) > 10
    for name in left_out:
        named = re.findall(r"`(test_\w+)`", ast.get_docstring(tests[name]) or "")
        assert named, f"{name} is marked scale: name the smaller test with its claim in the docstring, in backticks"
        for each in named:
            assert each in tests, f"{name} names {each}, which is no test"
            assert tests[each] is None or not all_marked(tests[each]), f"{name} names {each}, which make test leaves out, too"
