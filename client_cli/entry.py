"""``trifarm`` and ``python -m client_cli``: what runs first, so that a Ctrl-C while the rest is loaded is no traceback."""

import os
import sys

INTERRUPTED = 130
STANDARD_ERROR = 2


def main() -> None:
    """Run the command line and end the process with its exit code."""
    _open_what_is_closed()
    try:
        from client_cli.main import run

        run()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def _open_what_is_closed() -> None:
    """A standard stream that the caller has closed leads nowhere; else the next file to be opened would be in its place."""
    while (last := os.open(os.devnull, os.O_RDWR)) <= STANDARD_ERROR:
        os.set_inheritable(last, True)
    os.close(last)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
