"""A command line as a table of rows: each names a command and where it lives, and its module is imported when it is asked for."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand
from typer.main import get_group

from client_cli.exit_codes import ExitCode, epilog
from client_cli.wrong_values import Commands


@dataclass(frozen=True)
class Row:
    """A command, or a group of them.

    Attributes:
        name: as a user types it.
        where: its function, or a group's ``typer.Typer``, such as "client_cli.report:report".
        exit_codes: how it may end; empty for a group, whose commands name their own.
        help: its line in the list of all commands, which is the first paragraph of its own help.
    """

    name: str
    where: str
    exit_codes: tuple[ExitCode, ...]
    help: str

    def load(self) -> Any:
        """The command itself; imports its module."""
        module, _, attribute = self.where.partition(":")
        found = getattr(import_module(module), attribute)
        holder = typer.Typer(add_completion=False)
        if isinstance(found, typer.Typer):
            holder.add_typer(found, name=self.name)
        else:
            holder.command(self.name, epilog=epilog(*self.exit_codes))(found)
        return get_group(holder).commands[self.name]


class Announced(TyperCommand):
    """Stands for a command of which only the row is needed so far: in the list of commands, and until it is called."""

    def __init__(self, row: Row):
        super().__init__(row.name, help=row.help)
        self._row = row

    def make_context(self, *arguments: Any, **named: Any) -> Any:
        """The context of the command itself, in which typer then runs that one."""
        return self._row.load().make_context(*arguments, **named)


class LoadedWhenRead(Mapping[str, Any]):
    """The commands of a table by name: names cost nothing; reading a command imports its module."""

    def __init__(self, rows: tuple[Row, ...]):
        self._rows = {row.name: row for row in rows}

    def __getitem__(self, name: str) -> Any:
        return self._rows[name].load()

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)


def contents(rows: tuple[Row, ...]) -> type[Commands]:
    """The group of a table's commands, for ``typer.Typer(cls=...)``."""
    announced = {row.name: Announced(row) for row in rows}

    class Contents(Commands):
        def __init__(self, **attributes: Any):
            super().__init__(**attributes)
            self.commands: Any = LoadedWhenRead(rows)

        def get_command(self, _context: Any, name: str) -> Any:
            return announced.get(name)

        def list_commands(self, _context: Any) -> list[str]:
            return list(announced)

    return Contents
