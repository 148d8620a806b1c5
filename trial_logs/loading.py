"""Loading a program: nothing of it is garbage."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def everything_stays() -> Iterator[None]:
    """Look for no garbage while modules are imported, and never again at what they left.

    To look through all of it again and again takes a fifth to a quarter of what the largest programs need to start.
    """
    was_looked_for = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_looked_for:
            gc.enable()
