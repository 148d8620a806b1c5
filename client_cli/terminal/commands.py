"""Groups of commands: what they say of wrong arguments, and a group that imports a command only when it is asked for."""

import ast
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command as built

from client_cli.terminal.exit_codes import ExitCode, epilog
from client_cli.terminal.wrong_values import with_meant

GROUP = "commands"
"""What a module calls its group of commands; the function of its callback is called like the module."""


class Commands(TyperGroup):
    """A group of commands that says what is wrong with an argument without the words of the library that found it."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command that is asked for.

        Raises:
            BadParameter: an argument is wrong.
        """
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = error.message.removeprefix("Value error, ").replace("Input should", "it should", 1)
            error.message = with_meant(error.message)
            raise


@dataclass(frozen=True)
class Entry:
    """Where a command stands, as ``module:function`` or ``module:commands`` for a group, and the codes that it exits with."""

    place: str
    exit_codes: tuple[ExitCode, ...] = ()

    def command(self, name: str) -> Any:
        """The command, imported."""
        module, _, attribute = self.place.partition(":")
        found = getattr(import_module(module), attribute)
        alone = typer.Typer(cls=Commands, add_completion=False, pretty_exceptions_enable=False)
        alone.callback()(lambda: None)
        if isinstance(found, typer.Typer):
            alone.add_typer(found, name=name)
        else:
            alone.command(name, epilog=epilog(*self.exit_codes))(found)
        group = built(alone)
        assert isinstance(group, TyperGroup)
        return group.commands[name]

    def summary(self) -> str:
        """The first line of the command's docstring, read from its source without importing it."""
        module, _, attribute = self.place.partition(":")
        wanted = module.rpartition(".")[2] if attribute == GROUP else attribute
        spec = find_spec(module)
        assert spec is not None and spec.origin is not None, module
        tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
        function = next(node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == wanted)
        return (ast.get_docstring(function) or "").partition("\n\n")[0]


class LazyCommands(Commands):
    """A group whose commands are imported when they run; its help needs none of them."""

    groups: ClassVar[dict[str, dict[str, Entry]]] = {}

    @property
    def entries(self) -> dict[str, Entry]:
        """The commands of all groups."""
        return {name: entry for group in self.groups.values() for name, entry in group.items()}

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002
        """The names, group by group."""
        return list(self.entries)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        """The command of a name, None if there is none."""
        if cmd_name not in self.commands and cmd_name in self.entries:
            self.add_command(self.entries[cmd_name].command(cmd_name))
        return self.commands.get(cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that is asked for; an unknown one is refused with those of similar names."""
        if args[0] in self.entries:
            return super().resolve_command(ctx, args)
        with self._summaries():
            return super().resolve_command(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help: every command with its summary, in its group."""
        with self._summaries():
            super().format_help(ctx, formatter)

    @contextmanager
    def _summaries(self) -> Iterator[None]:
        """Every command stands there by its name and summary alone."""
        commands = self.commands
        self.commands = {
            name: TyperCommand(name, help=entry.summary(), rich_help_panel=title)
            for title, group in self.groups.items()
            for name, entry in group.items()
        }
        try:
            yield
        finally:
            self.commands = commands
