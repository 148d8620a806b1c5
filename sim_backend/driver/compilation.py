"""Keeps compiled functions between processes, so that only the first robot of a machine waits for the compiler.

numba's own cache looks at the file of the function it compiles, not at the files of the functions that this one calls. The
cache is therefore kept in a folder named after what is in all sources that may take part, and after numba's version: not
after where they are, so that clones and installed packages of one version compile once.
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
from numba.core.caching import UserProvidedCacheLocator

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
    before = _SETTINGS.CACHE_DIR, _SETTINGS.CACHE_LOCATOR_CLASSES
    try:
        _SETTINGS.CACHE_DIR = str(_folder(*beside))
        _SETTINGS.CACHE_LOCATOR_CLASSES = f"{__name__}.{ByContent.__name__}"
        with warnings.catch_warnings():
            warnings.simplefilter("error", numba.NumbaWarning)
            return compile_function(True)
    except (OSError, RuntimeError, numba.NumbaWarning):
        return compile_function(False)
    finally:
        _SETTINGS.CACHE_DIR, _SETTINGS.CACHE_LOCATOR_CLASSES = before


class ByContent(UserProvidedCacheLocator):
    """Where numba keeps a function, whatever folder its source lies in, and by which it knows that the source is the same."""

    def __init__(self, py_func: Callable, py_file: str) -> None:
        super().__init__(py_func, py_file)
        self._cache_path = str(Path(_SETTINGS.CACHE_DIR) / Path(py_file).parent.name)

    def get_source_stamp(self) -> bytes:
        """Digest of the source."""
        return hashlib.sha256(Path(self._py_file).read_bytes()).digest()


@functools.cache
def _folder(*beside: str) -> Path:
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    digest = hashlib.sha256(numba.__version__.encode())
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
