"""Silence around libraries that write to the terminal: stdout is for the command's result, and one line says what went wrong."""

import contextlib
import io
import os
import sys
import warnings
from collections.abc import Iterator


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Nothing that is printed inside is seen, by Python or by native code; exceptions pass."""
    kept = [(each.fileno(), os.dup(each.fileno())) for each in (sys.__stdout__, sys.__stderr__) if each is not None]
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for number, _ in kept:
            os.dup2(nowhere, number)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for number, copy in kept:
            os.dup2(copy, number)
            os.close(copy)
        os.close(nowhere)


def first_sentence(error: BaseException) -> str:
    """What an error says, as one line of at most 200 characters: the last line of a trace that names an error, or the first."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    named = [line for line in lines if line.startswith(("RuntimeError:", "ValueError:", "IndexError:", "AssertionError:"))]
    line = named[-1].partition(":")[2].strip() if named else (lines[0] if lines else "")
    return f"{type(error).__name__}: {line}"[:200]
