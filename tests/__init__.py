"""Tests of trifarm; ``tests/unit`` mirrors the code by path."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
"""The clone."""
