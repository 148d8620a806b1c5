"""``python -m chaos run|robot|link|services …``: breaks a farm, or is one process of the farm that is broken."""

import os
import sys

from chaos.ending import end_with_parent

PROGRAMS = ("run", "robot", "services", "link")


def main() -> int:
    """Runs one of the programs; gives the exit code."""
    program, *arguments = sys.argv[1:]
    sys.argv = [f"python -m chaos {program}", *arguments]
    match program:
        case "robot":
            from chaos.robot_process import main as robot

            end_with_parent()
            robot(arguments)
        case "services":
            from chaos.services import main as services

            services()
        case "link":
            from chaos.link import main as link

            end_with_parent()
            link(arguments)
        case "run":
            from chaos.run import main as run

            return run(arguments)
        case _:
            sys.exit(f"python -m chaos {program}: choose from {', '.join(PROGRAMS)}")
    return 0


if __name__ == "__main__":
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    sys.exit(main())
