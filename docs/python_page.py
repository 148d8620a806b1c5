"""Writes ``docs/python.md`` from the docstrings of ``trifarm``: ``python docs/python_page.py [FILE]``."""

import argparse
import inspect
from enum import Enum
from pathlib import Path

import trifarm

PAGE = Path(__file__).parent / "python.md"
HEAD = """# The Python API

`import trifarm` is the whole public API; everything else in this repository may move. A name is loaded when it is first used, so
the import itself costs nothing. Environments and `pack` need the extra `learning` (`pip install -e '.[learning]'` in the clone).
`python docs/python_page.py` writes this page from the docstrings, and a test runs its examples.

| name | what it is |
|---|---|
"""
EXAMPLE = "Example:"
LONG = 100
"""Characters of a signature that is written over several lines."""


def page() -> str:
    """The page as Markdown."""
    rows = [f"| [`{name}`](#{_anchor(name)}) | {_first_sentence(getattr(trifarm, name))} |" for name in trifarm.__all__]
    return HEAD + "\n".join(rows) + "\n" + "".join(f"\n{_section(name)}" for name in trifarm.__all__)


def _anchor(name: str) -> str:
    """Of the section of a name; ``Report`` and ``report`` are two."""
    before = [each for each in trifarm.__all__[: trifarm.__all__.index(name)] if each.lower() == name.lower()]
    return name.lower() + (f"-{len(before)}" if before else "")


def _section(name: str) -> str:
    found = getattr(trifarm, name)
    lines = [f"## {name}", "", *_prose(found), "", "```python", *_signature(name, found), "```"]
    for example in _examples(found):
        lines += ["", "```pycon", *example, "```"]
    if inspect.isclass(found):
        for method, function in _public_methods(found):
            lines += ["", f"### {name}.{method}", "", *_prose(function)]
            is_property = isinstance(inspect.getattr_static(found, method), property)
            written = [f"trifarm.{name}.{method}"] if is_property else _signature(f"{name}.{method}", function)
            lines += ["", "```python", *written, "```"]
            for example in _examples(function):
                lines += ["", "```pycon", *example, "```"]
    return "\n".join(lines) + "\n"


def _public_methods(found: type):
    """Methods and properties of a class that are its own and documented."""
    for name, value in vars(found).items():
        function = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
        if not name.startswith("_") and inspect.isfunction(function) and function.__doc__:
            yield name, function


def _signature(name: str, found: object) -> list[str]:
    try:
        signature = inspect.signature(found)
    except ValueError:
        return [f"trifarm.{name}"]
    given = [each for each in signature.parameters.values() if each.name not in ("self", "cls")]
    if isinstance(found, type) and issubclass(found, Exception):
        return [f"trifarm.{name}"]
    written = [_parameter(each) for each in given]
    first = next((at for at, each in enumerate(given) if each.kind is each.KEYWORD_ONLY), None)
    if first is not None and not any(each.kind is each.VAR_POSITIONAL for each in given):
        written.insert(first, "*")
    names = ", ".join(written)
    if len(names) < LONG:
        return [f"trifarm.{name}({names})"]
    return [f"trifarm.{name}(", *(f"    {each}," for each in names.split(", ")), ")"]


def _parameter(given: inspect.Parameter) -> str:
    stars = {given.VAR_POSITIONAL: "*", given.VAR_KEYWORD: "**"}.get(given.kind, "")
    return f"{stars}{given.name}" + ("" if given.default is given.empty else f"={_default(given.default)}")


def _default(value: object) -> str:
    if callable(value):
        return "..."
    written = value.value if isinstance(value, Enum) else value
    return f'"{written}"' if isinstance(written, str) else repr(written)


def _lines(found: object) -> list[str]:
    return (inspect.getdoc(found) or "").splitlines()


def _first_sentence(found: object) -> str:
    return " ".join(_lines(found)).partition(". ")[0].partition("  ")[0].rstrip(".").replace("``", "`").replace("|", "\\|")


def _prose(found: object) -> list[str]:
    """The docstring without its example; the lists of Google's style become lists of Markdown."""
    lines: list[str] = []
    in_list = False
    for line in _lines(found):
        text = line.replace("``", "`")
        if text.strip() == EXAMPLE:
            break
        if text in ("Args:", "Returns:", "Raises:"):
            lines += [f"**{text[:-1]}**", ""]
            in_list = text != "Returns:"
        elif text.startswith("        "):
            lines[-1] += f" {text.strip()}"
        elif text.startswith("    ") and in_list:
            name, colon, rest = text.strip().partition(": ")
            lines.append(f"- `{name}`: {rest}" if colon else f"- {name}")
        else:
            lines.append(text.strip())
    return "\n".join(lines).strip().splitlines()


def _examples(found: object):
    lines, example = _lines(found), []
    if any(line.strip() == EXAMPLE for line in lines):
        begin = next(index for index, line in enumerate(lines) if line.strip() == EXAMPLE)
        example = [line[4:] for line in lines[begin + 1 :]]
        yield "\n".join(example).strip().splitlines()


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("page", type=Path, nargs="?", default=PAGE)
    asked.parse_args().page.write_text(page(), encoding="utf-8")
