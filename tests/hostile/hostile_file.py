"""What a hostile file is: its content, and the answer that it must meet."""

from dataclasses import dataclass

LATE = {"before_parsing": False}
"""Of files that only the converting child can tell."""


@dataclass(frozen=True)
class Hostile:
    """A file, the type of the problem that refuses it, and whether the answer names ``trifarm pack``."""

    filename: str
    content: bytes
    slug: str
    packs: bool = False
    before_parsing: bool = True
