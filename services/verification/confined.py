"""``python -m services.verification.confined CPU_S MODULE ARGUMENT...``: limits itself, then becomes the named module.

The module reads a log that anyone may have made; limits outlive the exec, and the module need not know of them.
"""

import os
import resource
import sys

MEMORY_LIMIT_BYTES = 3 * 1024**3
FILE_LIMIT_BYTES = 64 * 1024**2
"""Room for the compiled functions that numba keeps."""
NICENESS = 10
"""Robots run trials in real time beside this; nobody waits for a verdict as they wait for their next action."""


def main() -> None:
    """Never returns."""
    cpu_s, module, *arguments = sys.argv[1:]
    os.nice(NICENESS)
    resource.setrlimit(resource.RLIMIT_CPU, (int(cpu_s), int(cpu_s)))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT_BYTES, MEMORY_LIMIT_BYTES))
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_LIMIT_BYTES, FILE_LIMIT_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # What is still held open from the parent beyond the standard three is none of the child's business.
    os.closerange(3, 1024)
    os.execv(sys.executable, [sys.executable, "-P", "-m", module, *arguments])  # noqa: S606 - without a shell is the point


if __name__ == "__main__":
    main()
