"""One attempt, named."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Claim:
    """A trial, the fence of one lease of it, and the robot that holds this lease."""

    trial_id: str
    fence: int
    robot: str
