"""``trifarm`` and ``python -m client_cli``: what runs first, so that a Ctrl-C while the rest is loaded is no traceback."""

import sys

INTERRUPTED = 130


def main() -> None:
    """Run the command line and end the process with its exit code."""
    try:
        from client_cli.main import run

        run()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
