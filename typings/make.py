"""``python typings/make.py``: writes what Pyrefly is told of MuJoCo's compiled modules, read from the wheel itself.

The wheel has no stubs, so that a checker finds no name in it; but pybind11 writes the signature of every function and the type of
every attribute into its docstring. The stub has only what the project names: run this again for a name that Pyrefly does not
know, and when MuJoCo's version changes.
"""

import ast
import importlib
import keyword
import re
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
STUB = ROOT / "typings" / "mujoco-stubs" / "__init__.pyi"
SPEAKERS = ("sim_backend", "robot_farm", "tests")
"""Who names MuJoCo."""
MODULES = ("_callbacks", "_enums", "_functions", "_render", "_specs", "_structs")
OF_BOTH = ("MjOption", "MjStatistic", "MjVisual")
RETURNED = {("MjSpec", "compile"): "MjModel"}
"""What the wheel calls an ``object`` and its documentation calls more."""
HEAD = """# Written by typings/make.py from mujoco's wheel.
import collections.abc
import typing

import numpy
import numpy.typing

_Got = typing.TypeVar("_Got")
_Given = typing.TypeVar("_Given")

class _Attribute(typing.Generic[_Got, _Given]):
    def __get__(self, instance: object, owner: type) -> _Got: ...
    def __set__(self, instance: object, value: _Given) -> None: ...

class _Enum:
    name: str
    value: int
    def __int__(self) -> int: ...
    def __index__(self) -> int: ...
    def __or__(self, other: typing.SupportsInt) -> int: ...
    def __ror__(self, other: typing.SupportsInt) -> int: ...

"""
_SIGNATURE = re.compile(r"^(?:\d+\. )?\w+\((?P<parameters>.*)\) -> (?P<returned>.+)$", re.MULTILINE)
_LIKE = "numpy.typing.ArrayLike"
_ARRAY = re.compile(r"typing\.Annotated\[(numpy\.typing\.NDArray\[[\w.]+\]), \"\[[^\]]+\]\"(?:, \"[\w.]+\")*\]")
_SPECIAL = {f"__{name}__" for name in ("init", "len", "iter", "next", "getitem", "setitem", "enter", "exit", "copy")}


def named() -> Callable[[str], bool]:
    """Tells whether a name is a word of the project's code."""
    files = (file for folder in SPEAKERS for file in (ROOT / folder).rglob("*.py"))
    return {word for file in files for word in re.findall(r"\b[A-Za-z]\w*", file.read_text())}.__contains__


def stub(wanted: Callable[[str], bool]) -> str:
    """The stub, with the names that are wanted and the classes that those speak of."""
    described = {name: lines for module in MODULES for name, lines in _described(f"mujoco.{module}", wanted)}
    kept = set(filter(wanted, described))
    while more := {word for name in kept for word in re.findall(r"\w+", described[name])} & described.keys() - kept:
        kept |= more
    return HEAD + "\n".join(described[name] for name in sorted(kept)) + "\n"


def _described(module: str, wanted: Callable[[str], bool]) -> Iterator[tuple[str, str]]:
    for name, thing in sorted(vars(importlib.import_module(module)).items()):
        if isinstance(thing, type):
            called = _called(module, name)
            yield called, "\n".join(_class(called, thing, wanted))
        elif callable(thing) and wanted(name):
            yield name, "\n".join(_function(name, thing.__doc__))


def _called(module: str, name: str) -> str:
    """A class's name in the stub: specifications and compiled models have classes of the same name."""
    return f"_Spec{name}" if module == "mujoco._specs" and name in OF_BOTH else name


def _class(name: str, thing: type, wanted: Callable[[str], bool]) -> list[str]:
    lines, is_enum = list[str](), "__entries" in vars(thing)
    for member, found in vars(thing).items():
        if not (wanted(member) or member in _SPECIAL or isinstance(found, type)) or keyword.iskeyword(member):
            continue
        if isinstance(found, thing):
            lines.append(f"{member}: typing.ClassVar[{name}]")
        elif is_enum:
            continue
        elif isinstance(found, type):
            lines += _class(member, found, wanted)
        elif isinstance(found, property):
            lines.append(_attribute(member, found))
        elif isinstance(found, staticmethod):
            lines += _function(member, found.__func__.__doc__, above=["@staticmethod"])
        elif callable(found) and not (member == "__init__" and "->" not in (found.__doc__ or "")):
            lines += _function(member, found.__doc__, returned=RETURNED.get((name, member)))
    return [f"class {name}{'(_Enum)' if is_enum else ''}:", *(f"    {line}" for line in lines or ["..."]), ""]


def _attribute(name: str, found: property) -> str:
    got = re.search(r" -> (.+)", (found.fget and found.fget.__doc__) or "")
    given = re.search(r"arg1: (.+)\) -> None", (found.fset and found.fset.__doc__) or "")
    taken = "typing.Never" if found.fset is None else _taken(given[1]) if given else "typing.Any"
    return f"{name}: _Attribute[{_type(got[1]) if got else 'typing.Any'}, {taken}]"


def _function(name: str, doc: str | None, *, above: list[str] | None = None, returned: str | None = None) -> list[str]:
    """One line for a function, several for one that takes this or that."""
    found = [(_parameters(each["parameters"]), returned or _type(each["returned"])) for each in _SIGNATURE.finditer(doc or "")]
    found = found or [("*args: typing.Any, **kwargs: typing.Any", "typing.Any")]
    marks = [*(["@typing.overload"] if len(found) > 1 else []), *(above or [])]
    return [line for taken, given in found for line in (*marks, f"def {name}({taken}) -> {given}: ...")]


def _parameters(given: str) -> str:
    """Parameters with their types; what a default is matters to nobody but whether there is one."""
    return ", ".join(_parameter(each) for each in _split(given))


def _parameter(given: str) -> str:
    name, _, rest = given.partition(": ")
    kind, _, default = rest.partition(" = ")
    if not rest or name == "self":
        return name
    if not default:
        return f"{name}: {_taken(kind)}"
    return f"{name}: {_taken(kind)}{' | None' if default == 'None' and not kind.endswith('None') else ''} = ..."


def _split(given: str) -> list[str]:
    """At commas outside of brackets and texts."""
    parts, depth = [""], 0
    for character in given:
        depth += (character in "[(<") - (character in "])>")
        if character == "," and not depth:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts if part.strip()]


def _taken(given: str) -> str:
    """The type of what is handed in: sequences and arrays are made of whatever looks like one, unless they are written to."""
    if "flags.writeable" in given:
        return _type(given)
    given = _ARRAY.sub(_LIKE, given)
    return _type(re.sub(r"collections\.abc\.Sequence\[typing\.Supports\w+ \| typing\.SupportsIndex\]", _LIKE, given))


def _type(given: str) -> str:
    """A type as Python writes it; ``typing.Any`` for one that only C++ knows."""
    given = _ARRAY.sub(r"\1", given)
    given = re.sub(r"mujoco::python::(Mj(?:Model|Data)\w+Views)", r"_\1", given)
    given = re.sub(r"(mujoco\._[a-z]+)\.(\w+)", lambda found: _called(found[1], found[2]), given)
    try:
        ast.parse(given, mode="eval")
    except SyntaxError:
        return "typing.Any"
    return given


if __name__ == "__main__":
    STUB.parent.mkdir(exist_ok=True)
    STUB.write_text(stub(named()))
