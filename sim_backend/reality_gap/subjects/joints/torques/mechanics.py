"""The mechanics of k joints in one episode: what the motors gave, less what inverse dynamics needs for the measured motion.

And what each number of an effect adds to it, and to the current: images of motors, of the clock and of bodies.
"""

from collections.abc import Callable, Sequence

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import Channel, keys_of
from sim_backend.reality_gap.measured.sensor_noise import white_noise
from sim_backend.reality_gap.subjects.joints.laws import motor_law
from sim_backend.reality_gap.subjects.joints.laws.body_law import BodyLaw
from sim_backend.reality_gap.subjects.joints.laws.motor_torques import BEFORE_CURRENT, MotorTorques
from sim_backend.reality_gap.subjects.joints.laws.plant import InverseDynamics, Plant
from sim_backend.reality_gap.subjects.joints.laws.state import CLOCK, LINK_CENTRES, LINK_INERTIA, SENSED, JointState, Term
from sim_backend.reality_gap.subjects.joints.laws.trajectory import Trajectory

_OF_BODIES = (frozenset(keys_of(Channel.MECHANICS)) | {LINK_INERTIA, *LINK_CENTRES}) - frozenset(motor_law.KEYS)


class Mechanics:
    """Residuals of one episode of s samples and t rows.

    Args:
        plant: of the nominal model.
        path: the smoothed episode.
        motors: along it.
    """

    def __init__(self, plant: Plant, path: Trajectory, motors: MotorTorques) -> None:
        self._path, self._motors = path, motors
        self._raw_acceleration = path.raw_acceleration
        self.dynamics: InverseDynamics = plant.derivatives(path.position, path.velocity, path.acceleration)
        """Inverse dynamics of the nominal model along the episode."""
        motion = (path.position, path.velocity, path.acceleration)
        self.body = BodyLaw(self.dynamics, path, plant.own_values, plant.gravity_m_s2, lambda: plant.link_derivatives(*motion))
        """What effects on bodies change in it."""

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
        return self.body.needed_nm(state, self._path.acceleration if smooth else self._raw_acceleration, play)


JointImage = tuple[int, int, np.ndarray]
"""Term, joint, and the term's image in that joint's equation at full rate, shape (s,)."""


class MechanicsImages:
    """Images along one episode of s samples and t rows.

    Args:
        path: the smoothed episode.
        motors: along it.
        body: effects on bodies along it.
        thin: takes series at full rate, shape (..., s), to rows, shape (..., t), as the residual was.
        steps_back: whether a later clock looks exactly as commands that are later at all joints do, from sample to sample.
    """

    def __init__(
        self,
        path: Trajectory,
        motors: MotorTorques,
        body: BodyLaw,
        thin: Callable[[np.ndarray], np.ndarray],
        *,
        steps_back: bool = False,
    ) -> None:
        self._steps_back = steps_back
        self._path, self._motors, self._body, self._thin = path, motors, body, thin
        self._row_s = path.step_s * path.every

    def of(self, state: JointState, terms: Sequence[Term]) -> tuple[np.ndarray, list[JointImage]]:
        """Images in the mechanics, shape (t, k, m), and in the current."""
        images, currents = self._of_motors(state, terms)
        for i, term in enumerate(terms):
            if term.key in _OF_BODIES:
                images[:, :, i] = self._body.image(state, term)
        return images, currents

    def _of_motors(self, state: JointState, terms: Sequence[Term]) -> tuple[np.ndarray, list[JointImage]]:
        """Those of the motor law, of the clock and of the sensors; series are thinned out together, which is quicker."""
        base = [self._motors.along_sent(state, j) for j in range(self._motors.joints)]
        images = self._of_recording(base, terms)
        nets: list[JointImage] = []
        plays: list[JointImage] = []
        currents: list[JointImage] = []
        for i, term in enumerate(terms):
            if term.key not in motor_law.KEYS:
                continue
            for j in [term.index] if state.width(term.key) > 1 else range(self._motors.joints):
                if term.key == motor_law.COGGING:
                    nets.append((i, j, self._motors.cogging_image(state, term, j)))
                    continue
                current, net, play = self._motors.along_sent(state.moved(term, term.probe), j)
                if term.key in BEFORE_CURRENT and self._motors.measured_nm is not None:
                    currents.append((i, j, (base[j][0] - current) / term.probe))
                    continue
                nets.append((i, j, (base[j][1] - net) / term.probe))
                if term.key == motor_law.GAP:
                    plays.append((i, j, (base[j][2] - play) / term.probe))
        for (i, j, _), image in zip(nets, _together(nets, self._thin), strict=True):
            images[:, j, i] += image
        for (i, j, _), image in zip(plays, _together(plays, self._path.smoothed), strict=True):
            images[:, :, i] += self._body.play_image(image, j)
        return images, currents

    def _of_recording(self, base: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], terms: Sequence[Term]) -> np.ndarray:
        """When the torque acted, and which share of what was measured beyond what was sent is noise; shape (t, k, m)."""
        images = np.zeros((*self._path.position.shape, len(terms)))
        for i, term in enumerate(terms):
            if term.key == CLOCK:
                currents = np.stack([current for current, _, _ in base])  # friction goes by the encoders' clock
                if self._steps_back:
                    images[:, :, i] = self._thin(np.diff(currents, axis=1, prepend=currents[:, :1])).T / self._path.step_s
                else:
                    images[:, :, i] = np.gradient(self._thin(currents).T, self._row_s, axis=0)
            if term.key == SENSED and self._motors.measured_nm is not None:
                images[:, term.index, i] = self._thin(self._motors.measured_nm[term.index] - base[term.index][0])
        return images


def _together(series: Sequence[JointImage], thin: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    return thin(np.stack([image for _, _, image in series])) if series else np.zeros((0, 0))
