"""The mechanics of k joints in one episode: what the motors gave, less what inverse dynamics needs for the measured motion."""

import numpy as np

from sim_backend.reality_gap.joints.gravity_tilt import tilted_gravity
from sim_backend.reality_gap.joints.motor_torques import MotorTorques
from sim_backend.reality_gap.joints.plant import InverseDynamics, Plant
from sim_backend.reality_gap.joints.state import JointState
from sim_backend.reality_gap.joints.trajectory import Trajectory
from sim_backend.reality_gap.sensor_noise import white_noise


class Mechanics:
    """Residuals of one episode of s samples and t rows.

    Args:
        plant: of the nominal model.
        path: the smoothed episode.
        motors: along it.
    """

    def __init__(self, plant: Plant, path: Trajectory, motors: MotorTorques) -> None:
        self._path, self._motors = path, motors
        self._gravity_m_s2 = plant.gravity_m_s2
        self._in_dynamics = plant.own_values
        self._raw_acceleration = path.raw_acceleration
        self.dynamics: InverseDynamics = plant.derivatives(path.position, path.velocity, path.acceleration)
        """Inverse dynamics of the nominal model along the episode."""

    @property
    def pressing_nm(self) -> np.ndarray:
        """What the motors give beyond what the motion needs, shape (t, k), N m."""
        return self._path.averaged(self._motors.acting_nm).T - self.dynamics.torque_nm

    @property
    def sensor_noise_nm(self) -> np.ndarray:
        """What noise of the encoders alone makes of :meth:`residual`, shape (k,), N m."""
        path = self._path
        return self._inertia() @ (path.position_noise_rad / (path.step_s * path.every) ** 2)

    @property
    def torque_error_floor_nm(self) -> np.ndarray:
        """What the sensors' noise alone makes of :meth:`torque_error`, shape (k,), N m."""
        path = self._path
        moved = self._inertia() @ path.acceleration_noise(path.position_noise_rad)
        measured = path.joints.measured_torque_nm
        sensed = 0.0 if measured is None else white_noise(measured) * np.sqrt(2.0 * path.cutoff_hz * path.step_s)
        return np.hypot(moved, sensed)

    def _inertia(self) -> np.ndarray:
        return np.sqrt(np.mean(self.dynamics.by_acceleration**2, axis=0))

    def residual(self, state: JointState) -> tuple[np.ndarray, np.ndarray]:
        """Of the mechanics, shape (t, k), and of the current at full rate, shape (s, k); N m."""
        given = self._given(state)
        net = self._path.averaged(given[1]).T
        current = np.zeros(self._path.fast_position.shape)
        if self._motors.measured_nm is not None:
            current = (given[0] - self._motors.measured_nm).T
        return net - self._needed(state, self._play(given[2])), current

    def torque_error(self, state: JointState) -> np.ndarray:
        """What the motors gave beyond what the smoothed motion needs, both smoothed alike, shape (t, k), N m."""
        given = self._given(state)
        return self._path.smoothed(given[1]).T - self._needed(state, self._play(given[2]), smooth=True)

    def _given(self, state: JointState) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Torque of the current, torque left at the joint, and play, each (k, s)."""
        motors = [self._motors.along(state, j) for j in range(self._motors.joints)]
        current, net, play = (np.stack([m[i] for m in motors]) for i in range(3))
        return current, net, play

    def _play(self, plays: np.ndarray) -> np.ndarray:
        path = self._path
        return path.smoothed(plays).T if plays.any() else np.zeros_like(path.position)

    def _needed(self, state: JointState, play: np.ndarray, *, smooth: bool = False) -> np.ndarray:
        """Torques that the motion needs; ``play`` smoothed, shape (t, k)."""
        d, path = self.dynamics, self._path
        acceleration = path.acceleration if smooth else self._raw_acceleration
        torque = d.torque_nm + np.einsum("tkl,tl->tk", d.by_acceleration, acceleration - path.acceleration)
        torque += np.einsum("tkl,l->tk", d.by_link_mass, state.value("link_mass.factor") - 1.0)
        torque += self._beyond_dynamics(state, "rotor_inertia.armature_kg_m2") * acceleration
        torque += self._beyond_dynamics(state, "viscous_friction.damping_nm_s_rad") * path.velocity
        stiffness, reference = (state.value(f"joint_stiffness.{name}") for name in ("stiffness_nm_rad", "reference_rad"))
        torque += stiffness * (path.position - reference)
        torque += np.einsum("tkg,g->tk", d.by_gravity, self._gravity(state) - self._gravity_m_s2)
        moved = state.value("encoder_offset.offset_rad") + play
        torque -= np.einsum("tkl,tl->tk", d.by_position, moved)
        if play.any():
            step_s = path.step_s * path.every
            torque -= np.einsum("tkl,tl->tk", d.by_acceleration, np.gradient(np.gradient(play, step_s, axis=0), step_s, axis=0))
        return torque

    def _beyond_dynamics(self, state: JointState, key: str) -> np.ndarray:
        """What a state has of a parameter beyond what the nominal model's dynamics contain, shape (k,)."""
        return state.value(key) - self._in_dynamics[key]

    def _gravity(self, state: JointState) -> np.ndarray:
        roll_rad, pitch_rad = (state.value(f"table_tilt.{name}")[0] for name in ("roll_rad", "pitch_rad"))
        return tilted_gravity(self._gravity_m_s2, roll_rad, pitch_rad) + state.value("gravity.offset_m_s2")
