"""Writes ``docs/settings.md`` from the settings of the services: ``python docs/settings_page.py [FILE]``."""

import argparse
from enum import Enum
from pathlib import Path
from typing import Any

from pydantic.fields import FieldInfo

from services.settings import Settings

PAGE = Path(__file__).parent / "settings.md"
HEAD = """# Settings of the services

For operators: every variable that a process of the services reads. `python docs/settings_page.py` writes this page from the
settings themselves. [running-a-farm.md](running-a-farm.md) and [scale.md](scale.md) say how they are used; those of robots are
flags, which `python -m robot_farm --help` names.

| variable | usual | meaning |
|---|---|---|
"""


def page() -> str:
    """The page as Markdown."""
    return HEAD + "".join(_row(name, field) for name, field in Settings.model_fields.items())


def _row(name: str, field: FieldInfo) -> str:
    meaning = (field.description or "").replace("``", "`").replace("|", "\\|")
    secret = "; a secret" if "Secret" in str(field.annotation) else ""
    return f"| `TRIFARM_{name.upper()}` | {_usual(field.default)} | {meaning}{secret} |\n"


def _usual(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{value.value if isinstance(value, Enum) else f'{value:g}' if isinstance(value, float) else value}`"


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("page", type=Path, nargs="?", default=PAGE)
    asked.parse_args().page.write_text(page())
