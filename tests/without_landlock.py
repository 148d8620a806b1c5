"""``python tests/without_landlock.py PYTHON-ARGUMENTS...``: an interpreter on a kernel that says it has no Landlock."""

import errno
import os
import sys

from jail import kernel, seccomp

CREATE_RULESET = 444
_ALLOW, _ERROR = 0x7FFF0000, 0x00050000


def main() -> None:
    kernel.prctl(kernel.PR_SET_NO_NEW_PRIVS, 1)
    seccomp.install(
        b"".join(
            (
                seccomp.instruction(0x20, 0),
                seccomp.instruction(0x15, CREATE_RULESET, 0, 1),
                seccomp.instruction(0x06, _ERROR | errno.ENOSYS),
                seccomp.instruction(0x06, _ALLOW),
            )
        )
    )
    os.execv(sys.executable, [sys.executable, *sys.argv[1:]])


if __name__ == "__main__":
    main()
