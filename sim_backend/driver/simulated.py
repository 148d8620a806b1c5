"""The simulated driver: sole owner of the physics state of n TriFingers."""

# mujoco fills its namespace when it is imported, which the type checker cannot see
# pyright: reportAttributeAccessIssue=false
from collections.abc import Sequence
from dataclasses import fields

import mujoco
import numpy as np
from mujoco.batch import Batch

from sim_backend.driver import native_control
from sim_backend.driver.driver import Command, Measurement, Segment, Start
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.scene import compile_scene

_RECORD = ("qpos", "qvel", "ctrl")


class PhysicsDivergedError(Exception):
    """The physics became unstable (a warning counter of MuJoCo rose); the trial cannot go on."""


class SimulatedDriver:
    """n simulated robots, advanced together; a trial has n = 1.

    With ``safety=False`` commands act unchanged, which is what a replay of recorded applied torques needs.
    """

    def __init__(
        self, *, robots: int = 1, threads: int = 1, physics_step_s: float = c.PHYSICS_STEP_S, safety: bool = True
    ) -> None:
        native_control.install()
        self._model = compile_scene(physics_step_s=physics_step_s, control_slots=native_control.CONTROL_SLOTS)
        self._batch = Batch(self._model, robots, nthread=threads)
        self._robots = robots
        self._safety = safety
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._slots = self._batch.bind("userdata")
        self._torque_nm = np.zeros((robots, 9))
        self._step = 0
        self._buffers: dict[int, dict] = {}

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model; not to be changed."""
        return self._model

    @property
    def robots(self) -> int:
        """Number of robots advanced together."""
        return self._robots

    def reset(self, start: Start, robots: np.ndarray | None = None) -> None:
        """Put robots and cubes at rest at their start.

        Args:
            start: poses, one row for each robot that is reset.
            robots: indices of the robots to reset; all of them if None.
        """
        rows = np.arange(self._robots) if robots is None else np.asarray(robots)
        self._batch.reset(ids=rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos[rows, :9] = start.joint_position_rad
        self._qpos[rows, 9:12] = start.cube_position_world_m
        self._qpos[rows, 12:16] = start.cube_quat_wxyz
        self._qvel[rows] = 0.0
        self._slots[rows, native_control.SLOT_SAFETY_ON] = float(self._safety)
        self._slots[rows, native_control.SLOT_POSITION_TARGET :] = np.nan
        self._batch.forward(ids=rows)
        self._torque_nm[rows] = 0.0
        if robots is None:
            self._step = 0

    def measure(self) -> Measurement:
        """The present state of all robots; copies, so that it may be kept."""
        return Measurement(
            joint_position_rad=self._qpos[:, :9].copy(),
            joint_velocity_rad_s=self._qvel[:, :9].copy(),
            joint_torque_nm=self._torque_nm.copy(),
            cube_position_world_m=self._qpos[:, 9:12].copy(),
            cube_quat_wxyz=self._qpos[:, 12:16].copy(),
        )

    def advance(self, schedule: Sequence[tuple[Command, int]]) -> Segment:
        """Apply commands one after the other, each for a number of physics steps.

        Raises:
            PhysicsDivergedError: a simulation became unstable.
        """
        if all(command.position_target_rad is None for command, _ in schedule):
            steps = sum(steps for _, steps in schedule)
            torque_nm, row = np.empty((self._robots, steps, 9)), 0
            for command, steps in schedule:
                torque_nm[:, row : row + steps] = command.desired_torque_nm[:, None]
                row += steps
            return self.advance_torques(torque_nm)
        return _joined([self._advance_one(command, steps) for command, steps in schedule if steps])

    def _advance_one(self, command: Command, steps: int) -> Segment:
        torque_nm = np.repeat(command.desired_torque_nm[:, None], steps, axis=1)
        if command.position_target_rad is None:
            return self.advance_torques(torque_nm)
        self._slots[:, native_control.SLOT_POSITION_TARGET :] = command.position_target_rad
        segment = self.advance_torques(torque_nm)
        self._slots[:, native_control.SLOT_POSITION_TARGET :] = np.nan
        return segment

    def advance_torques(self, torque_nm: np.ndarray) -> Segment:
        """Apply a torque of its own in every step; shape (n, steps, 9), N m, C-contiguous."""
        steps = torque_nm.shape[1]
        before_qpos, before_qvel = self._qpos[:, None, :].copy(), self._qvel[:, None, :].copy()
        out = self._batch.rollout(steps, torque_nm, record=_RECORD, out=self._buffer(steps))
        if self._batch.warning.any():
            raise PhysicsDivergedError(f"the physics diverged between step {self._step} and {self._step + steps}")
        qpos = np.concatenate([before_qpos, out["qpos"][:, :-1]], axis=1)
        qvel = np.concatenate([before_qvel, out["qvel"][:, :-1]], axis=1)
        applied = out["ctrl"].copy()
        self._torque_nm = applied[:, -1].copy()
        first, self._step = self._step, self._step + steps
        return Segment(
            first_step=first,
            joint_position_rad=qpos[:, :, :9],
            joint_velocity_rad_s=qvel[:, :, :9],
            desired_torque_nm=torque_nm,
            applied_torque_nm=applied,
            cube_position_world_m=qpos[:, :, 9:12],
            cube_quat_wxyz=qpos[:, :, 12:16],
        )

    def _buffer(self, steps: int) -> dict:
        """Output arrays by length of the segment; a trial uses only two lengths."""
        if steps not in self._buffers:
            n = self._robots
            self._buffers[steps] = {
                "qpos": np.empty((n, steps, self._model.nq)),
                "qvel": np.empty((n, steps, self._model.nv)),
                "ctrl": np.empty((n, steps, self._model.nu)),
            }
        return self._buffers[steps]


def _joined(segments: list[Segment]) -> Segment:
    """Segments that follow each other as one."""
    arrays = {
        field.name: np.concatenate([getattr(segment, field.name) for segment in segments], axis=1)
        for field in fields(Segment)
        if field.name != "first_step"
    }
    return Segment(first_step=segments[0].first_step, **arrays)
