"""How commands that run in a process of their own say why they failed: a line, and the one document of ``--json``."""

import json
import os
import sys
from collections.abc import Callable

from api_schemas.error import error_document

EXIT_OTHER, EXIT_UNUSABLE = 1, 2
TITLES = {EXIT_OTHER: "error", EXIT_UNUSABLE: "wrong usage"}


def refused(error: Exception | str, as_json: bool, code: int = EXIT_UNUSABLE) -> int:
    """Say it in a line on stderr and, if JSON was asked for, in the one document on stdout.

    Not for Ctrl-C, of which ``trifarm`` prints the document itself, when the process has ended.

    Args:
        error: what was raised, or a sentence.
        as_json: whether JSON was asked for.
        code: the exit code, one of ``TITLES``.

    Returns:
        The exit code.
    """
    said = f"cannot use {error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else str(error)
    if as_json:
        print(json.dumps(error_document(TITLES[code], said, code)))
    print(f"error: {said}", file=sys.stderr)
    return code


def ended(main: Callable[[], int]) -> int:
    """The exit code of a program whose stdout may take nothing more: one line on a full disk, no word behind a closed pipe.

    Raises:
        OSError: ``main`` raised it, and stdout takes what it is given.
    """
    try:
        code = main()
        sys.stdout.flush()
    except OSError as error:
        if not _stdout_is_stuck():
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains of the rest when it ends
        if isinstance(error, BrokenPipeError):
            return EXIT_OTHER
        return refused(f"cannot use the standard output: {error.strerror}", as_json=False)
    return code


def _stdout_is_stuck() -> bool:
    """It takes no empty line either; what else failed has a traceback to come, which an empty line does not spoil."""
    try:
        print(flush=True)
    except OSError:
        return True
    return False
