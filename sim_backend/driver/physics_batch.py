"""n simulations as the driver sees them, whatever steps them."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np


class BackendError(ValueError):
    """The physics cannot run where it was asked for; the message says what is missing and what to do."""


class UnvariedFieldError(BackendError):
    """A robot's model differs from the others' in fields that must be the same for all."""

    def __init__(self, row: int, fields: Sequence[str]) -> None:
        super().__init__(f"robot {row} differs from the others in {', '.join(fields)}, which mujoco_warp has once for all")
        self.row = row


class Rows(NamedTuple):
    """What n simulations did in some steps.

    ``qpos`` (n, steps, 16) and ``qvel`` (n, steps, 15) are the state before each step, ``ctrl`` (n, steps, 9) is the torque that
    acted in it, N m, and ``report`` (n, steps, 36) what the control callback reported, as ``effects/record.py`` says; None if
    nobody asked.
    """

    qpos: np.ndarray
    qvel: np.ndarray
    ctrl: np.ndarray
    report: np.ndarray | None


class PhysicsBatch(Protocol):
    """n simulations, as ``mujoco.batch.Batch`` has them and as far as the driver uses them."""

    @property
    def models(self) -> Any:
        """Of all simulations, or None."""
        ...

    @property
    def warning(self) -> Any:
        """What MuJoCo warned of, by simulation."""
        ...

    def bind(self, name: str) -> np.ndarray:
        """A field of all simulations, shape (n, size), to be read and written in place."""
        ...

    def set_models(self, models: list[mujoco.MjModel] | None) -> None:
        """A model for each simulation; the batch's own for all if None."""
        ...

    def reset(self, *, ids: np.ndarray, stage: Any) -> None:
        """Put some simulations into their initial state."""
        ...

    def forward(self, *, ids: np.ndarray) -> None:
        """Compute what follows from the states of some simulations."""
        ...

    def advance(self, torque_nm: np.ndarray, *, report: bool) -> Rows:
        """Advance by some steps with a torque of its own in each, shape (n, steps, 9), N m, C-contiguous.

        What the rows of a simulation hold that became unstable is without meaning from that step on.
        """
        ...
