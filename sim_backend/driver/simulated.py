"""The simulated driver: sole owner of the physics state of n TriFingers."""

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from sim_backend.driver import native_control
from sim_backend.driver.driver import Command, Measurement, Segment, Start
from sim_backend.driver.fingertip_force import fingertip_force
from sim_backend.driver.physics_backend import PhysicsBackend, open_batch
from sim_backend.driver.physics_batch import BackendError, UnvariedFieldError
from sim_backend.driver.robot_model import compile_robot, moving_bounds, needs_model, parameter_slots
from sim_backend.effects import record as r
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Acts
from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE, Shape, resting_height_m
from sim_backend.trifinger.scene import ARENA_BITS

_STATE = ("time", "qpos", "qvel", "act", "history", "qacc_warmstart", "ctrl", "qfrc_applied", "userdata")
"""Fields of a simulation that its next step depends on."""


class PhysicsDivergedError(Exception):
    """The physics became unstable (a warning counter of MuJoCo rose); the trial cannot go on."""


class SimulatedDriver:
    """n simulated robots, advanced together; a trial has n = 1.

    Args:
        robots: n.
        threads: threads that advance them.
        physics_step_s: integration step, s.
        safety: with False commands act unchanged, which is what a replay of recorded applied torques needs.
        physics: the robots' effects; nominal if None.
        shape: the object in the arena.
        divergence_ends: whether a simulation that becomes unstable ends all (:class:`PhysicsDivergedError`); otherwise
            :attr:`diverged` says which they are, and they must be reset.
        backend: where the physics runs.
    """

    def __init__(
        self,
        *,
        robots: int = 1,
        threads: int = 1,
        physics_step_s: float = c.PHYSICS_STEP_S,
        safety: bool = True,
        physics: Physics | None = None,
        shape: Shape = CUBE,
        divergence_ends: bool = True,
        backend: PhysicsBackend = PhysicsBackend.CPU,
    ) -> None:
        native_control.install()
        self._step_s, self._shape, self._robots, self._safety = physics_step_s, shape, robots, safety
        self._model = compile_robot(Physics.nominal(), shape=shape, physics_step_s=physics_step_s)
        self._batch = open_batch(backend, self._model, robots, threads)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._slots, self._force = self._batch.bind("userdata"), self._batch.bind("qfrc_applied")
        self._torque_nm = np.zeros((robots, 9))
        self._step, self._divergence_ends = 0, divergence_ends
        self._after_wall = 1 + max(geom for geom in range(self._model.ngeom) if self._model.geom_contype[geom] == ARENA_BITS)
        self._models: list[mujoco.MjModel] | None = None
        self._watches_wall = robots == 1 and PhysicsBackend(backend) is PhysicsBackend.CPU
        self.set_physics(physics or Physics.nominal(robots))

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled nominal model; not to be changed."""
        return self._model

    @property
    def robots(self) -> int:
        """Number of robots advanced together."""
        return self._robots

    @property
    def physics(self) -> Physics:
        """The robots' effects."""
        return self._physics

    @property
    def shape(self) -> Shape:
        """The object in the arena."""
        return self._shape

    @property
    def cube_velocity(self) -> np.ndarray:
        """Velocities of the objects now, shape (n, 6): m/s in the world's frame, then rad/s in the object's."""
        return self._qvel[:, 9:15].copy()

    @property
    def diverged(self) -> np.ndarray:
        """Which simulations became unstable since their reset, shape (n,)."""
        return self._batch.warning.reshape(self._robots, -1).any(axis=1)

    @property
    def motor_temperature_rise_k(self) -> np.ndarray:
        """Temperatures of the motors above ambient now, shape (n, 9), K; zero without effects."""
        return self._slots[:, r.TEMPERATURE : r.TEMPERATURE + 9].copy()

    def rest_height_m(self, quat_wxyz: np.ndarray) -> np.ndarray:
        """Height of the object's centre when it rests on the table with the orientations of shape (n, 4); shape (n,), m."""
        return resting_height_m(self._shape, quat_wxyz) * self._physics.value("cube_size.factor")

    def set_physics(self, physics: Physics, robots: np.ndarray | None = None) -> None:
        """Give the robots other effects; their states stay, so that it may happen between control periods.

        Args:
            physics: of the robots that are changed.
            robots: their indices; all of them if None.
        """
        rows = np.arange(self._robots) if robots is None else np.asarray(robots)
        if physics.n != len(rows):
            raise ValueError(f"the physics is that of {physics.n} robots; it is to be that of {len(rows)}")
        self._physics = physics if robots is None else self._physics.with_rows(rows, physics)
        self._compile_models(physics, rows)
        self._effects_on = not self._physics.is_nominal
        self._slots[:, r.EFFECTS_ON] = float(self._effects_on)
        if not self._effects_on:
            self._force[:] = 0.0
        self._write_parameters(physics, rows)

    def _compile_models(self, physics: Physics, rows: np.ndarray) -> None:
        """Models of their own for the robots that need one; a nominal batch shares one model.

        A robot alone has always its own: the parts of its wall are switched off and on in it.
        """
        if not needs_model(self._physics):
            self._models = [copy.copy(self._model)] if self._watches_wall else None
        else:
            self._models = self._models or [self._model] * self._robots
            differs = needs_model(physics)
            for i, row in enumerate(rows):
                own = compile_robot(physics.row(i), shape=self._shape, physics_step_s=self._step_s) if differs else self._model
                self._models[row] = own
        if self._models is not None or self._batch.models is not None:
            try:
                self._batch.set_models(self._models)
            except UnvariedFieldError as error:
                raise BackendError(f"{_with_effects(self._physics.row(error.row))}: {error}; leave them out") from error

    def _write_parameters(self, physics: Physics, rows: np.ndarray) -> None:
        self._slots[rows, r.BOUNDS_ON] = moving_bounds(physics)
        self._slots[rows, r.CONTROL_SLOTS : r.FILTERED_VELOCITY] = parameter_slots(physics, self._slots[rows, r.SEED])

    def reset(self, start: Start, robots: np.ndarray | None = None) -> None:
        """Put robots and cubes at their start.

        Args:
            start: poses, one row for each robot that is reset.
            robots: indices of the robots to reset; all of them if None.
        """
        rows = np.arange(self._robots) if robots is None else np.asarray(robots)
        self._batch.reset(ids=rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._look_at_whole_wall()
        self._qpos[rows, :9] = start.joint_position_rad
        self._qpos[rows, 9:12] = start.cube_position_world_m
        self._qpos[rows, 12:16] = start.cube_quat_wxyz
        self._qvel[rows] = 0.0
        if start.joint_velocity_rad_s is not None:
            self._qvel[rows, :9] = start.joint_velocity_rad_s
        if start.cube_velocity is not None:
            self._qvel[rows, 9:15] = start.cube_velocity
        self._batch.forward(ids=rows)  # while the record is empty, so that the control callback rests
        self._slots[rows] = 0.0
        self._slots[rows, r.AFTER_WALL] = self._after_wall if self._watches_wall else 0.0
        self._slots[rows, r.SAFETY_ON] = float(self._safety)
        self._slots[rows, r.STEP_S] = self._step_s
        self._slots[rows, r.EFFECTS_ON] = float(self._effects_on)
        for first in (r.POSITION_TARGET, r.HELD_TARGET, r.AWAITED_TARGET):
            self._slots[rows, first : first + 9] = np.nan
        if start.noise_seed is not None:
            self._slots[rows, r.SEED] = start.noise_seed
        for first in (r.FILTERED_VELOCITY, r.ROTOR):
            self._slots[rows, first : first + 9] = self._qvel[rows, :9]
        if start.motor_temperature_rise_k is not None:
            self._slots[rows, r.TEMPERATURE : r.TEMPERATURE + 9] = start.motor_temperature_rise_k
        self._write_parameters(self._physics.rows(rows), rows)
        self._torque_nm[rows] = 0.0
        if robots is None:
            self._step = 0

    def state(self) -> dict[str, Any]:
        """What :meth:`restore` needs to go on from here: numbers and arrays, one row for each robot."""
        fields_now = {name: self._batch.bind(name).copy() for name in _STATE}
        return {"fields": fields_now, "physics": dict(self._physics.given), "torque_nm": self._torque_nm, "step": self._step}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`state` of a driver of as many robots gave, with the same bits."""
        self.set_physics(Physics(self._robots, dict(state["physics"])))
        self._batch.reset(ids=np.arange(self._robots), stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._look_at_whole_wall()
        for name, values in state["fields"].items():
            self._batch.bind(name)[:] = values
        self._torque_nm, self._step = np.array(state["torque_nm"]), int(state["step"])

    def _look_at_whole_wall(self) -> None:
        """Switch on what was switched off where the last trial ended."""
        if self._watches_wall and self._models:
            for name in ("body_contype", "body_conaffinity"):
                getattr(self._models[0], name)[:] = getattr(self._model, name)

    def measure(self, *, feel: bool = False) -> Measurement:
        """The present state of all robots; copies, so that it may be kept.

        Args:
            feel: whether the fingertips' forces are measured, too, which costs a forward pass for each robot.

        Raises:
            BackendError: forces cannot be had on this back end.
        """
        position, velocity = self._qpos[:, :9].copy(), self._qvel[:, :9].copy()
        measured_position, measured_velocity = position, velocity
        if self._effects_on:
            measured_position, measured_velocity = np.empty_like(position), np.empty_like(velocity)
            native_control.measurer()(self._slots, position, velocity, measured_position, measured_velocity)
        return Measurement(
            joint_position_rad=measured_position,
            joint_velocity_rad_s=measured_velocity,
            joint_torque_nm=self._torque_nm.copy(),
            true_joint_position_rad=position,
            true_joint_velocity_rad_s=velocity,
            cube_position_world_m=self._qpos[:, 9:12].copy(),
            cube_quat_wxyz=self._qpos[:, 12:16].copy(),
            fingertip_force=fingertip_force(self._batch, self._models or [self._model] * self._robots) if feel else None,
        )

    def advance(self, schedule: Sequence[tuple[Command, int]]) -> Segment:
        """Apply commands one after the other, each for a number of physics steps.

        Raises:
            PhysicsDivergedError: a simulation became unstable.
        """
        if all([command.position_target_rad is None for command, _ in schedule]):
            torque_nm, row = np.empty((self._robots, sum([steps for _, steps in schedule]), 9)), 0
            for command, steps in schedule:
                torque_nm[:, row : row + steps] = command.desired_torque_nm[:, None]
                row += steps
            return self.advance_torques(torque_nm)
        return _joined([self._advance_one(command, steps) for command, steps in schedule if steps])

    def _advance_one(self, command: Command, steps: int) -> Segment:
        torque_nm = np.repeat(command.desired_torque_nm[:, None], steps, axis=1)
        if command.position_target_rad is None:
            return self.advance_torques(torque_nm)
        self._slots[:, r.POSITION_TARGET : r.POSITION_TARGET + 9] = command.position_target_rad
        segment = self.advance_torques(torque_nm)
        self._slots[:, r.POSITION_TARGET : r.POSITION_TARGET + 9] = np.nan
        return segment

    def advance_torques(self, torque_nm: np.ndarray) -> Segment:
        """Apply a torque of its own in every step; shape (n, steps, 9), N m, C-contiguous."""
        steps = torque_nm.shape[1]
        qpos, qvel, applied, report = self._batch.advance(torque_nm, report=self._effects_on)
        if self._divergence_ends and np.count_nonzero(self._batch.warning):  # a third of what any() takes
            raise PhysicsDivergedError(f"the physics diverged between step {self._step} and {self._step + steps}")
        position, velocity = qpos[:, :, :9], qvel[:, :, :9]
        measured = (position, velocity, applied, applied)
        if report is not None:
            measured = tuple(report[:, :, first : first + 9] for first in (0, 9, 18, 27))
        self._torque_nm = measured[2][:, -1].copy()
        first, self._step = self._step, self._step + steps
        return Segment(
            first_step=first,
            joint_position_rad=measured[r.MEASURED_POSITION // 9],
            joint_velocity_rad_s=measured[r.MEASURED_VELOCITY // 9],
            measured_torque_nm=measured[r.MEASURED_TORQUE // 9],
            desired_torque_nm=torque_nm,
            applied_torque_nm=applied,
            effective_torque_nm=measured[r.EFFECTIVE_TORQUE // 9],
            true_joint_position_rad=position,
            true_joint_velocity_rad_s=velocity,
            cube_position_world_m=qpos[:, :, 9:12],
            cube_quat_wxyz=qpos[:, :, 12:16],
        )


def _with_effects(physics: Physics) -> str:
    """Which effects a robot has that a model shows."""
    names = [effect.name for effect in CATALOGUE.values() if effect.acts is Acts.MODEL and physics.has(effect.name)]
    return f"the effects {', '.join(names)} cannot be had on this physics back end"


def _joined(segments: list[Segment]) -> Segment:
    """Segments that follow each other as one."""
    arrays = {
        name: np.concatenate([getattr(segment, name) for segment in segments], axis=1)
        for name in Segment._fields
        if name != "first_step"
    }
    return Segment(first_step=segments[0].first_step, **arrays)
