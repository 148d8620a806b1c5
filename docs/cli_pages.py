"""Writes ``docs/cli``, a page a group of commands, from help texts and ``cli_notes.md``: ``python docs/cli_pages.py [DIR]``."""

import argparse
import re
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import typer
from typer.core import TyperGroup
from typer.main import get_command

from client_cli.main import GROUPS, app
from client_cli.terminal.exit_codes import MEANING

HERE = Path(__file__).parent
FOLDER = HERE / "cli"
NOTES = HERE / "cli_notes.md"
INDEX = "README.md"
EVERYWHERE = "trifarm"
"""The section of the notes for all commands."""
ENDLESS = 2**31
"""A larger bound of an option is the width of its type."""
VALUES = {int: "N", float: "X", str: "TEXT", Path: "PATH"}
WRITTEN_BY = "`python docs/cli_pages.py` writes this page from the commands' own help and from `docs/cli_notes.md`."


def pages() -> dict[str, str]:
    """The pages as Markdown, by file name.

    Raises:
        ValueError: a note is about no command.
    """
    notes = _notes()
    documents = {_file(title): f"# {title}\n\n{WRITTEN_BY}\n" for title in GROUPS}
    rows = {title: "" for title in GROUPS}
    for title, group in GROUPS.items():
        for path, command in (found for name in group for found in commands(name)):
            heading = f"trifarm {_usage(path, command)}"
            documents[_file(title)] += f"\n## `{heading}`\n\n{_section(command, notes.pop(path, ''))}"
            rows[title] += f"| [`trifarm {path}`]({_file(title)}#{_anchor(heading)}) | {_prose(command)[0]} |\n"
    everywhere = notes.pop(EVERYWHERE).replace("### ", "## ")
    if notes:
        raise ValueError(f"{NOTES.name} tells of {', '.join(notes)}, which trifarm has not")
    tables = "".join(f"\n## {title}\n\n| command | what it does |\n|---|---|\n{rows[title]}" for title in GROUPS)
    codes = "".join(f"| {int(code)} | {text} |\n" for code, text in MEANING.items())
    head = f"# The command line\n\n`trifarm` is the command for users and operators. {WRITTEN_BY}\n"
    documents[INDEX] = f"{head}{tables}\n## Exit codes\n\n| code | meaning |\n|---|---|\n{codes}\n{everywhere}\n"
    return documents


def commands(name: str) -> Iterator[tuple[str, Any]]:
    """A command and those below it, each with what a user types for it."""
    group = get_command(app)
    assert isinstance(group, TyperGroup)
    yield from _below(name, group.get_command(typer.Context(group), name))


def _below(path: str, command: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(command, TyperGroup):
        yield path, command
        return
    if command.invoke_without_command:
        yield path, command
    for name in command.list_commands(typer.Context(command)):
        yield from _below(f"{path} {name}", command.get_command(typer.Context(command), name))


def _usage(path: str, command: Any) -> str:
    return " ".join([path, *(each.metavar for each in command.params if _is_argument(each))])


def _is_argument(parameter: Any) -> bool:
    return parameter.param_type_name == "argument"


def _file(title: str) -> str:
    return f"{title.lower().replace(' ', '-')}.md"


def _anchor(heading: str) -> str:
    """Of a heading, as GitHub makes it."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


def _notes() -> dict[str, str]:
    """The notes by command, with links as seen from the pages."""
    text = re.sub(r"\]\((?!https?:|#)", "](../", NOTES.read_text(encoding="utf-8"))
    found = re.findall(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", text.replace("](../cli/", "]("), re.MULTILINE | re.DOTALL)
    return {name: note.strip() for name, note in found}


def _section(command: Any, note: str) -> str:
    rows = "".join(f"| {_name(each)} | {_meaning(each)} |\n" for each in command.params)
    codes = ", ".join(re.findall(r"(\d+) [a-z]", command.epilog))
    parts = ["\n\n".join(_prose(command)), f"| argument or option | meaning |\n|---|---|\n{rows.rstrip()}", note]
    return "\n\n".join(part for part in (*parts, f"[Exit codes]({INDEX}#exit-codes): {codes}") if part) + "\n"


def _prose(command: Any) -> list[str]:
    """The paragraphs of a command's help."""
    return [" ".join(paragraph.split()) for paragraph in command.help.split("\n\n")]


def _name(parameter: Any) -> str:
    if _is_argument(parameter):
        return _code(parameter.metavar)
    annotation = parameter.type_descriptor.annotation
    value = "" if _choices(annotation) else parameter.metavar or VALUES.get(annotation, "")
    return _code(f"{parameter.opts[0]} {value}".strip())


def _code(text: str) -> str:
    return f"`{text}`".replace("|", "\\|")


def _meaning(parameter: Any) -> str:
    """The help of a parameter with its choices, bounds and default."""
    facts = []
    if choices := _choices(parameter.type_descriptor.annotation):
        facts.append(f"One of {', '.join(f'`{choice}`' for choice in choices)}.")
    if parameter.min is not None and parameter.max is not None and parameter.max < ENDLESS:
        facts.append(f"From {parameter.min:g} to {parameter.max:g}.")
    if parameter.required and not _is_argument(parameter):
        facts.append("Required.")
    elif default := _default(parameter):
        facts.append(f"Default: `{default}`.")
    return " ".join([parameter.help.replace("|", "\\|"), *facts])


def _choices(annotation: Any) -> list[str]:
    if get_origin(annotation) is list:
        return _choices(get_args(annotation)[0])
    if get_origin(annotation) is Literal:
        return [_text(each) for each in get_args(annotation)]
    return [_text(each) for each in annotation] if isinstance(annotation, type) and issubclass(annotation, Enum) else []


def _default(parameter: Any) -> str:
    if isinstance(parameter.show_default, str):
        return parameter.show_default
    return "" if isinstance(parameter.default, bool | None) else _text(parameter.default)


def _text(value: object) -> str:
    if isinstance(value, Enum):
        return str(value.value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def write(folder: Path) -> None:
    """Write the pages and remove those of groups that are gone."""
    folder.mkdir(exist_ok=True)
    written = pages()
    for path in folder.glob("*.md"):
        if path.name not in written:
            path.unlink()
    for name, text in written.items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("folder", type=Path, nargs="?", default=FOLDER)
    write(asked.parse_args().folder)
