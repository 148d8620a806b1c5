"""Policies that come with the farm, as users name them."""

from pathlib import Path

from api_schemas.builtin_policies import BUILTIN, PREFIX
from client_cli.terminal.errors import UsageProblem


def builtin_named(file: Path) -> str:
    """The name in ``builtin:NAME``; empty if a file is meant.

    Raises:
        UsageProblem: no policy of this name comes with the farm.
    """
    text = str(file)
    if not text.startswith(PREFIX):
        return ""
    if (name := text.removeprefix(PREFIX)) not in BUILTIN:
        raise UsageProblem(f"no built-in policy {name!r}; choose from {', '.join(PREFIX + each for each in BUILTIN)}")
    return name
