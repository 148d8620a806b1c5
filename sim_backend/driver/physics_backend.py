"""Where the physics runs: MuJoCo on the processor, or mujoco_warp on a GPU; to the driver all are a batch."""

from enum import StrEnum

import mujoco
import numpy as np
from mujoco.batch import Batch

from sim_backend.driver.lone_simulation import LoneSimulation
from sim_backend.driver.physics_batch import PhysicsBatch, Rows


class PhysicsBackend(StrEnum):
    """What steps the physics. ``WARP_CPU`` is for tests of ``WARP`` on machines without a GPU; it is slower than ``CPU``."""

    CPU = "cpu"
    WARP = "warp"
    WARP_CPU = "warp-cpu"


class CpuBatch(Batch):
    """MuJoCo's own batch, with what the driver wants of a rollout."""

    def advance(self, torque_nm: np.ndarray, *, report: bool) -> Rows:
        """As of :class:`PhysicsBatch`; what is left of an unstable simulation's rows repeats the last."""
        steps = torque_nm.shape[1]
        before = {name: self.bind(name) for name in ("qpos", "qvel")}
        rows = {name: np.empty((self.nsim, steps, values.shape[1])) for name, values in before.items()}
        for name, values in before.items():
            rows[name][:, 0] = values
        after = self.rollout(steps, torque_nm, record=(*before, "ctrl", "sensordata") if report else (*before, "ctrl"))
        for name, values in rows.items():
            values[:, 1:] = after[name][:, :-1]
        return Rows(**rows, ctrl=after["ctrl"], report=after.get("sensordata"))


def open_batch(backend: PhysicsBackend | str, model: mujoco.MjModel, robots: int, threads: int) -> PhysicsBatch:
    """The batch of a back end.

    Raises:
        BackendError: it is not installed, or there is no device for it.
    """
    chosen = PhysicsBackend(backend)
    if chosen is PhysicsBackend.CPU:
        return LoneSimulation(model) if robots == 1 else CpuBatch(model, robots, nthread=threads)
    from sim_backend.driver.warp_batch import WarpBatch

    return WarpBatch(model, robots, device="cpu" if chosen is PhysicsBackend.WARP_CPU else None, threads=threads)
