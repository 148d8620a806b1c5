"""Where this code lies, in a clone or in an installed package, and what only one of them has."""

from pathlib import Path

import client_cli
from api_schemas.job import TaskName
from client_cli.errors import UsageProblem

ROOT = Path(client_cli.__file__).resolve().parent.parent
"""The folder of all packages: a clone, or an environment's site-packages."""
SHIPPED = {TaskName.PUSH: "push", TaskName.LIFT: "lift"}
"""The reference policy of each task that has one."""


def clone() -> Path | None:
    """The clone that we run from; None in an installed package."""
    return ROOT if (ROOT / "pyproject.toml").exists() else None


def check_in_clone(command: str) -> None:
    """Refuse a command whose package the wheel leaves out.

    Raises:
        UsageProblem: we run from an installed package.
    """
    if clone() is None:
        raise UsageProblem(
            f"'{command}' is part of trifarm's repository and not of the installed package: "
            f"clone the repository, run 'make setup' there, and then '.venv/bin/trifarm {command}'"
        )


def shipped_weights(task: TaskName) -> Path:
    """The weights of the reference policy of a task, whose manifest lies beside them.

    Raises:
        UsageProblem: none is shipped for it.
    """
    if task not in SHIPPED:
        raise UsageProblem(
            f"no policy for {task.value} is shipped, only for {' and '.join(SHIPPED)}: name one with --policy FILE"
        )
    return ROOT / "sim_backend" / "training" / "reference_policies" / f"{SHIPPED[task]}.safetensors"
