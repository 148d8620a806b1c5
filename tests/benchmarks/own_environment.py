"""Environments of their own for packages that contradict our pins, made once in the user's cache."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "trifarm"
INSTALL_WITHIN_S = 1800


def python_of(name: str) -> Path:
    """The interpreter of an environment."""
    return CACHE / name / "bin" / "python"


def missing(name: str, packages: Sequence[str], *, make: bool = True) -> str | None:
    """Why an environment with these packages cannot be had; None if it is there. Makes it where it is not.

    Args:
        name: its folder in the cache.
        packages: with their versions; another list makes it anew.
        make: False looks only.
    """
    place, wanted = CACHE / name, " ".join(packages)
    ready = place / "ready"
    if ready.exists() and ready.read_text() == wanted:
        return None
    if not make:
        return f"{wanted} is not installed in {place}"
    pip = [str(python_of(name)), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages]
    try:
        for command in ([sys.executable, "-m", "venv", "--clear", str(place)], pip):
            subprocess.run(command, check=True, capture_output=True, text=True, timeout=INSTALL_WITHIN_S)
    except subprocess.TimeoutExpired:
        return f"{wanted} could not be installed within {INSTALL_WITHIN_S} s"
    except (OSError, subprocess.CalledProcessError) as error:
        return f"{wanted} could not be installed: {str(getattr(error, 'stderr', error)).strip()[-500:]}"
    ready.write_text(wanted)
    return None
