"""Keeps compiled functions between processes, so that only the first robot of a machine waits for the compiler (3 s).

numba's own cache looks at the file of the function it compiles, not at the files of the functions that this one calls. The
cache is therefore kept in a folder named after all sources that may take part, and after numba's version.
"""

import functools
import hashlib
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import config

from sim_backend import effects, trifinger

Compiled = TypeVar("Compiled")
_SETTINGS: Any = config
"""numba makes them when it is imported, which the type checker cannot see."""


def compiled_once(compile_function: Callable[[bool], Compiled], *beside: str) -> Compiled:
    """The result of ``compile_function``, which is told whether to use the cache; without it where no folder can be written.

    Args:
        compile_function: compiles.
        beside: files of other packages whose functions are compiled into this one.
    """
    before = _SETTINGS.CACHE_DIR
    try:
        _SETTINGS.CACHE_DIR = str(_folder(*beside))
        with warnings.catch_warnings():
            warnings.simplefilter("error", numba.NumbaWarning)
            return compile_function(True)
    except (OSError, RuntimeError, numba.NumbaWarning):
        return compile_function(False)
    finally:
        _SETTINGS.CACHE_DIR = before


@functools.cache
def _folder(*beside: str) -> Path:
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    digest = hashlib.sha256(f"{numba.__version__} {Path(__file__).parent}".encode())  # numba's own key holds the path, too
    folders = {Path(__file__).parent, *(Path(path) for package in (effects, trifinger) for path in package.__path__)}
    for source in [*sorted(source for folder in folders for source in folder.glob("*.py")), *map(Path, beside)]:
        digest.update(source.read_bytes())
    folder = home / "trifarm" / f"compiled-{digest.hexdigest()[:16]}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def is_kept() -> bool:
    """Whether some process of these sources has compiled before and kept what it compiled."""
    try:
        return any(_folder().rglob("*.nbc"))
    except (OSError, RuntimeError):
        return False
