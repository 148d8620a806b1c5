"""Where the physics runs: MuJoCo's own batch on the processor, or mujoco_warp on a GPU; to the driver both are a batch."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Any, Protocol

import mujoco
import numpy as np
from mujoco.batch import Batch


class PhysicsBackend(StrEnum):
    """What steps the physics. ``WARP_CPU`` is for tests of ``WARP`` on machines without a GPU; it is slower than ``CPU``."""

    CPU = "cpu"
    WARP = "warp"
    WARP_CPU = "warp-cpu"


class BackendError(ValueError):
    """The physics cannot run where it was asked for; the message says what is missing and what to do."""


class UnvariedFieldError(BackendError):
    """A robot's model differs from the others' in fields that must be the same for all."""

    def __init__(self, row: int, fields: Sequence[str]) -> None:
        super().__init__(f"robot {row} differs from the others in {', '.join(fields)}, which mujoco_warp has once for all")
        self.row = row


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

    def rollout(self, nstep: int, control: np.ndarray, *, record: Sequence[Any]) -> dict[Any, np.ndarray]:
        """Advance by some steps with a control of its own in each, shape (n, steps, nu); fields after each step."""
        ...


def open_batch(backend: PhysicsBackend | str, model: mujoco.MjModel, robots: int, threads: int) -> PhysicsBatch:
    """The batch of a back end.

    Raises:
        BackendError: it is not installed, or there is no device for it.
    """
    chosen = PhysicsBackend(backend)
    if chosen is PhysicsBackend.CPU:
        return Batch(model, robots, nthread=threads)
    from sim_backend.driver.warp_batch import WarpBatch

    return WarpBatch(model, robots, device="cpu" if chosen is PhysicsBackend.WARP_CPU else None, threads=threads)
