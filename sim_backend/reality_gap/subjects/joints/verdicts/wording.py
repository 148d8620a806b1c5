"""Names in sentences."""

from collections.abc import Sequence


def listed(names: Sequence[str]) -> str:
    """As ``joint1, joint2 and joint3``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
