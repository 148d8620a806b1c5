"""What the farm calls its robots' physics: a name, never a number of it."""

from pathlib import Path

NOMINAL = "nominal"
NAMED_PHYSICS = (NOMINAL, "mild", "real")
"""The physics that every farm has; anything else is a file."""
FILE_PREFIX = "file:"


def physics_name(given: str) -> str:
    """The name under which physics is shown: itself if the farm has it, otherwise ``file:`` and the file's stem."""
    if given in NAMED_PHYSICS or given.startswith(FILE_PREFIX):
        return given
    return f"{FILE_PREFIX}{Path(given).stem}"
