"""Policies that come with the project: weights, manifest, recipe and training record of each."""

from pathlib import Path


def folder() -> Path:
    """Where they lie."""
    return Path(__file__).parent


def names() -> list[str]:
    """All of them."""
    return sorted(path.stem for path in folder().glob("*.safetensors"))
