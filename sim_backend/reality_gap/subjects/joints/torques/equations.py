"""Four equations for each joint that a healthy robot fulfils but for noise, and what each effect adds to them.

controller
    what was sent is what the safety pipeline makes of targets and of what the encoders reported (``sent_torque``);
current
    what the motor board measured is what was sent (``motor_torques``);
mechanics
    the torque at the motor is what inverse dynamics needs for the motion that was measured (``mechanics``);
velocity
    the reported velocity is the derivative of the reported position (``reported_velocity``).

Every number that an effect may change has an image in them: the difference that a small change makes, with signs such that a
residual is the sum of images times the true deviations.
"""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import Channel
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, Robot, UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.laws.motor_torques import MotorTorques
from sim_backend.reality_gap.subjects.joints.laws.plant import InverseDynamics, Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.laws.trajectory import Trajectory, trajectory
from sim_backend.reality_gap.subjects.joints.torques.counted_rows import is_lively, measured, near_end, rests
from sim_backend.reality_gap.subjects.joints.torques.mechanics import JointImage, Mechanics, MechanicsImages
from sim_backend.reality_gap.subjects.joints.torques.reported_velocity import SHOWN, velocity_image, velocity_residual
from sim_backend.reality_gap.subjects.joints.torques.sent_torque import LateCommands, SentTorque

_SMALLEST_IMAGE = 1e-9
_COUNTED_S = 0.003
"""From one counted sample to the next where noise is white and there are more than enough."""


@dataclass(frozen=True)
class Equation:
    """One equation of one joint in one episode.

    Attributes:
        channel: which.
        joint: index.
        episode: index of the recording.
        time_s: of the rows, shape (r,).
        residual: with the present state, shape (r,), N m or rad/s.
        images: of the terms in ``terms``, shape (r, m), per unit of the parameter.
        terms: indices into the list of terms.
        valid: rows that count, shape (r,).
        error_floor_nm: of mechanics that is known by its torques' errors: what the sensors' noise alone makes of them.
        sensor_noise: of mechanics: the encoders' white noise times inertia over the square of the time between rows.
        in_windows: whether that noise decides, so that rows are to be integrated twice over windows.
    """

    channel: Channel
    joint: int
    episode: int
    time_s: np.ndarray
    residual: np.ndarray
    images: np.ndarray
    terms: tuple[int, ...]
    valid: np.ndarray
    sensor_noise: float = 0.0
    error_floor_nm: float = 0.0
    in_windows: bool = False

    @property
    def counted_s(self) -> float:
        """How long the rows that count last together."""
        return float(self.valid.mean() * (self.time_s[-1] - self.time_s[0])) if len(self.time_s) > 1 else 0.0


class EpisodeEquations:
    """The equations of one episode.

    Args:
        plant: of the nominal model.
        path: the episode.
        episode: its index.
        robot: what is known of it. Of a TriFinger the driver's own pipeline made the sent torque, and the noise of its encoders
            decides how well the mechanics can be known; of any other robot errors of its torques do.
        reported: what the controller saw, where positions were corrected since.

    Attributes:
        is_measured: rows for which everything that the mechanics needs was measured, shape (t, k).
        valid_mechanics: those of them that count, shape (t, k).
    """

    def __init__(
        self,
        plant: Plant,
        path: Trajectory,
        episode: int,
        *,
        robot: Robot,
        reported: JointSignals | None = None,
    ) -> None:
        self._plant, self._path, self._episode, self._in_torques = plant, path, episode, isinstance(robot, UnknownRobot)
        self._motors = motors = MotorTorques(path, plant)
        self._mechanics = Mechanics(plant, path, motors)
        thin = path.smoothed if self._in_torques else path.averaged
        self._images = MechanicsImages(path, motors, self._mechanics.body, thin, steps_back=self._in_torques)
        self._sent: SentTorque | None = None
        if isinstance(robot, KnownTriFinger) and motors.sent_nm is not None and path.joints.position_target_rad is not None:
            self._sent = SentTorque(reported or path.joints, motors.sent_nm, path.step_s)
        self._sensor_noise_nm = self._mechanics.sensor_noise_nm
        self._ends = plant.range_rad.copy()
        self.is_measured = measured(path, motors.known, np.stack([plant.same_tree(j) for j in range(plant.joints)]))
        self.valid_mechanics = self.is_measured & ~rests(path) & ~near_end(path, self._ends)
        self._valid_velocity = path.valid & ~near_end(path, self._ends)
        if self._sent is not None:
            inertia = np.diagonal(self.dynamics.by_acceleration, axis1=1, axis2=2).mean(axis=0)
            self._valid_velocity &= is_lively(path, self.driving_nm, inertia)

    @property
    def path(self) -> Trajectory:
        """The smoothed episode."""
        return self._path

    @property
    def plant(self) -> Plant:
        """Of the nominal model."""
        return self._plant

    @property
    def dynamics(self) -> InverseDynamics:
        """Inverse dynamics of the nominal model along it."""
        return self._mechanics.dynamics

    @property
    def driving_nm(self) -> np.ndarray:
        """Torques that were sent, or measured if nothing else is known, shape (k, s), N m."""
        return self._motors.driving_nm

    @property
    def warmth_k(self) -> np.ndarray | None:
        """How much warmer than their surroundings the motors were, shape (k, s), K; NaN, or None, where nobody measured it."""
        return self._motors.warmth_k

    def later_targets_nm(self, j: int) -> np.ndarray | None:
        """As of the motors: what it takes from a joint's torque when its targets come a row later, shape (s,), N m."""
        return self._motors.later_targets_nm(j)

    @property
    def acting_nm(self) -> np.ndarray:
        """Torques that drive the mechanics: measured where they are known, shape (k, s), N m."""
        return self._motors.acting_nm

    @property
    def is_torque_known(self) -> np.ndarray:
        """Samples in which the torque that drives a joint was recorded, or follows from what was, shape (s, k)."""
        return self._motors.known

    @property
    def has_torque(self) -> np.ndarray:
        """Which joints have any torque, shape (k,)."""
        return np.asarray(self._motors.known.any(axis=0))

    @property
    def ends_rad(self) -> np.ndarray:
        """Ends of the joints' ranges, shape (k, 2)."""
        return self._plant.range_rad

    @property
    def pressing_nm(self) -> np.ndarray:
        """What the motors give beyond what the motion needs, shape (t, k), N m."""
        return self._mechanics.pressing_nm

    @property
    def torque_error_floor_nm(self) -> np.ndarray:
        """What the sensors' noise alone makes of :meth:`torque_error`, shape (k,), N m."""
        return self._mechanics.torque_error_floor_nm

    def torque_error(self, state: JointState) -> np.ndarray:
        """What the motors gave beyond what the smoothed motion needs, both smoothed alike, shape (t, k), N m."""
        return self._mechanics.torque_error(state)

    def current_difference(self, state: JointState) -> np.ndarray | None:
        """What was measured beyond what the model makes of what was sent, shape (s, k), N m; None without both."""
        return None if self._motors.measured_nm is None else -self._mechanics.residual(state)[1]

    def late_commands(self, state: JointState) -> LateCommands:
        """How late position targets came; none where no pipeline of the driver is known."""
        return LateCommands(np.zeros(0), 0.0, 0.0) if self._sent is None else self._sent.late_commands(state)

    def empty_equation(self, channel: Channel) -> Equation:
        """The frame of a mechanics or velocity equation: times without values."""
        rows = len(self._path.time_s)
        nothing = np.zeros(rows)
        return Equation(channel, 0, self._episode, self._path.time_s, nothing, np.zeros((rows, 0)), (), np.ones(rows, bool))

    def keep_off(self, joint: int, side: int, shift_rad: float) -> None:
        """Let rows near a shifted end of a joint not count: something else than the motor acts there."""
        self._ends[joint, side] += shift_rad
        away = ~near_end(self._path, self._ends)
        self.valid_mechanics &= away
        self._valid_velocity &= away

    def ignore_rattling(self, joint: int, apart: np.ndarray) -> None:
        """Let a joint whose rotor rattles not count, nor the joints that feel it while it does; ``apart`` of shape (t,)."""
        self.ignore_joint(joint)
        self._valid_velocity[:, joint] = False
        self.valid_mechanics[np.ix_(apart, self._plant.same_tree(joint))] = False

    def counting_only(self, rows: np.ndarray) -> "EpisodeEquations":
        """The same, of whose mechanics only some of the rows count, shape (t, k)."""
        fewer = copy.copy(self)
        fewer.valid_mechanics = self.valid_mechanics & rows
        return fewer

    def ignore_joint(self, joint: int) -> None:
        """Let no row of a joint's mechanics count."""
        self.valid_mechanics[:, joint] = False

    def equations(self, state: JointState, terms: Sequence[Term]) -> list[Equation]:
        """All equations of the episode with the images of all terms that have one in them."""
        images, currents = self._images.of(state, terms)
        if self._in_torques:
            found = self._mechanics_equations(self._mechanics.torque_error(state), images)
        else:
            residual, current = self._mechanics.residual(state)
            found = self._mechanics_equations(residual, images) + self._current_equations(current, currents)
        found += self._velocity_equations(state, terms)
        return found + self._controller_equations(state, terms)

    def _mechanics_equations(self, residual: np.ndarray, images: np.ndarray) -> list[Equation]:
        rows, path, found = slice(None), self._path, []
        if self._in_torques:
            rows = slice(None, None, max(1, round(0.4 / (path.cutoff_hz * path.step_s * path.every))))
        for j in range(self._plant.joints):
            used = np.flatnonzero(np.abs(images[:, j]).max(axis=0) > _SMALLEST_IMAGE)
            found.append(
                Equation(
                    Channel.MECHANICS,
                    j,
                    self._episode,
                    path.time_s[rows],
                    residual[rows, j],
                    images[rows, j][:, used],
                    tuple(used.tolist()),
                    self.valid_mechanics[rows, j],
                    float(self._sensor_noise_nm[j]),
                    float(self.torque_error_floor_nm[j]) if self._in_torques else 0.0,
                    in_windows=not self._in_torques,
                )
            )
        return found

    def _current_equations(self, residual: np.ndarray, images: list[JointImage]) -> list[Equation]:
        if self._motors.measured_nm is None:
            return []
        known = ~np.isnan(self._path.joints.position_rad) & self._motors.known
        return self._joint_equations(Channel.CURRENT, residual, images, known, self._path.recording.time_s, self._counted)

    def _velocity_equations(self, state: JointState, terms: Sequence[Term]) -> list[Equation]:
        path = self._path
        residual = velocity_residual(path, state, is_mean=self._sent is not None)
        if residual is None:
            return []
        images = [(i, t.index, velocity_image(path, state, t)) for i, t in enumerate(terms) if t.key in SHOWN]
        return self._joint_equations(Channel.VELOCITY, residual, images, self._valid_velocity, path.time_s, slice(None))

    def _controller_equations(self, state: JointState, terms: Sequence[Term]) -> list[Equation]:
        if self._sent is None:
            return []
        residual, images = self._sent.residual(state), self._sent.images(state, terms)
        everywhere = np.ones(residual.shape, bool)
        return self._joint_equations(Channel.CONTROLLER, residual, images, everywhere, self._path.recording.time_s, self._counted)

    @property
    def _counted(self) -> slice:
        return slice(None, None, max(1, round(_COUNTED_S / self._path.step_s)))

    def _joint_equations(
        self, channel: Channel, residual: np.ndarray, images: list[JointImage], valid: np.ndarray, time_s: np.ndarray, rows: slice
    ) -> list[Equation]:
        """One equation for each joint from images given by term and joint."""
        found = []
        for j in range(self._plant.joints):
            own = [(i, image) for i, owner, image in images if owner == j]
            stacked = np.stack([x[rows] for _, x in own], axis=1) if own else np.zeros((len(time_s[rows]), 0))
            terms = tuple(i for i, _ in own)
            found.append(Equation(channel, j, self._episode, time_s[rows], residual[rows, j], stacked, terms, valid[rows, j]))
        return found


def along(
    plant: Plant, recordings: Sequence[Recording], robot: Robot, progress: Callable[[str, float], None]
) -> list[EpisodeEquations]:
    """The equations of each recording.

    Raises:
        RecordingError: an episode is too short.
    """
    found = []
    for index, recording in enumerate(recordings):
        progress(f"smoothing {recording.name}", 0.15 * index / len(recordings))
        found.append(equations_of(plant, recording, index, robot))
    return found


def equations_of(
    plant: Plant, recording: Recording, index: int, robot: Robot, *, reported: JointSignals | None = None
) -> EpisodeEquations:
    """One episode's; ``reported`` is what the robot's controller saw, where positions were corrected since."""
    path = trajectory(recording, cutoff_hz=robot.cutoff_hz)
    return EpisodeEquations(plant, path, index, robot=robot, reported=reported)
