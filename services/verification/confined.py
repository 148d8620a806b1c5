"""``python -m services.verification.confined CPU_S MODULE ARGUMENT...``: runs the named module in a jail and its working folder.

The module reads a log that anyone may have made. It has a ``main``, which takes the arguments, and a ``prepare``, which is called
before the jail is closed and may still read and write what is kept between processes, such as compiled functions.
"""

import importlib
import os
import sys
from pathlib import Path

from jail.entering import enter
from jail.needs import Needs

MEMORY_LIMIT_BYTES = 3 * 1024**3
FILE_LIMIT_BYTES = 1024**2
NICENESS = 10
"""Robots run trials in real time beside this; nobody waits for a verdict as they wait for their next action."""


def main() -> int:
    """The module's own exit status."""
    cpu_s, name, *arguments = sys.argv[1:]
    os.nice(NICENESS)
    # What is still held open from the parent beyond the standard three is none of the child's business.
    os.closerange(3, 1024)
    module = importlib.import_module(name)
    module.prepare()
    enter(Needs(MEMORY_LIMIT_BYTES, int(cpu_s), FILE_LIMIT_BYTES, installation=True, folder=Path.cwd()))
    return module.main(arguments)


if __name__ == "__main__":
    sys.exit(main())
