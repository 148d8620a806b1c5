"""What each effect adds to the mechanics and to the current of one episode: images of motors, of the clock and of bodies."""

from collections.abc import Callable, Sequence

import numpy as np

from sim_backend.reality_gap.joints import motor_law
from sim_backend.reality_gap.joints.gravity_tilt import tilt_images
from sim_backend.reality_gap.joints.motor_torques import BEFORE_CURRENT, MotorTorques
from sim_backend.reality_gap.joints.plant import InverseDynamics
from sim_backend.reality_gap.joints.state import CLOCK, SENSED, JointState, Term
from sim_backend.reality_gap.joints.trajectory import Trajectory

JointImage = tuple[int, int, np.ndarray]
"""Term, joint, and the term's image in that joint's equation at full rate, shape (s,)."""


class MechanicsImages:
    """Images along one episode of s samples and t rows.

    Args:
        path: the smoothed episode.
        motors: along it.
        dynamics: inverse dynamics of the nominal model along it.
        gravity_m_s2: nominal, shape (3,).
        thin: takes series at full rate, shape (..., s), to rows, shape (..., t), as the residual was.
    """

    def __init__(
        self,
        path: Trajectory,
        motors: MotorTorques,
        dynamics: InverseDynamics,
        gravity_m_s2: np.ndarray,
        thin: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        self._path, self._motors, self._dynamics, self._thin = path, motors, dynamics, thin
        self._tilt_images = tilt_images(dynamics.by_gravity, gravity_m_s2)
        self._row_s = path.step_s * path.every

    def of(self, state: JointState, terms: Sequence[Term]) -> tuple[np.ndarray, list[JointImage]]:
        """Images in the mechanics, shape (t, k, m), and in the current."""
        images, currents = self._of_motors(state, terms)
        for i, term in enumerate(terms):
            if term.key not in (CLOCK, SENSED) and term.key not in motor_law.KEYS:
                images[:, :, i] = self._of_body(state, term)
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
                if term.effect == "cogging":
                    nets.append((i, j, self._motors.cogging_image(state, term, j)))
                    continue
                current, net, play = self._motors.along_sent(state.moved(term, term.probe), j)
                if term.key in BEFORE_CURRENT and self._motors.measured_nm is not None:
                    currents.append((i, j, (base[j][0] - current) / term.probe))
                    continue
                nets.append((i, j, (base[j][1] - net) / term.probe))
                if term.key == "backlash.gap_rad":
                    plays.append((i, j, (base[j][2] - play) / term.probe))
        for (i, j, _), image in zip(nets, _together(nets, self._thin), strict=True):
            images[:, j, i] += image
        for (i, j, _), image in zip(plays, _together(plays, self._path.smoothed), strict=True):
            images[:, :, i] += self._of_play(image, j)
        return images, currents

    def _of_recording(self, base: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], terms: Sequence[Term]) -> np.ndarray:
        """When the torque acted, and which share of what was measured beyond what was sent is noise; shape (t, k, m)."""
        images = np.zeros((*self._path.position.shape, len(terms)))
        for i, term in enumerate(terms):
            if term.key == CLOCK:
                torque = self._thin(np.stack([current for current, _, _ in base])).T  # friction goes by the encoders' clock
                images[:, :, i] = np.gradient(torque, self._row_s, axis=0)
            if term.key == SENSED and self._motors.measured_nm is not None:
                images[:, term.index, i] = self._thin(self._motors.measured_nm[term.index] - base[term.index][0])
        return images

    def _of_play(self, play: np.ndarray, j: int) -> np.ndarray:
        faster = np.gradient(np.gradient(play, self._row_s), self._row_s)
        return self._dynamics.by_position[:, :, j] * play[:, None] + self._dynamics.by_acceleration[:, :, j] * faster[:, None]

    def _of_body(self, state: JointState, term: Term) -> np.ndarray:
        """Of masses, gravity and what acts at the joint itself, shape (t, k); zeros for what acts elsewhere."""
        d, path, j = self._dynamics, self._path, term.index
        image = np.zeros_like(path.position)
        match term.key:
            case "link_mass.factor":
                return d.by_link_mass[:, :, j]
            case "gravity.offset_m_s2":
                return d.by_gravity[:, :, j]
            case "table_tilt.roll_rad":
                return self._tilt_images[:, :, 0]
            case "table_tilt.pitch_rad":
                return self._tilt_images[:, :, 1]
            case "encoder_offset.offset_rad":
                return -d.by_position[:, :, j]
            case "rotor_inertia.armature_kg_m2":
                image[:, j] = path.acceleration[:, j]
            case "viscous_friction.damping_nm_s_rad":
                image[:, j] = path.velocity[:, j]
            case "joint_stiffness.stiffness_nm_rad":
                key = "joint_stiffness.reference_rad"
                image[:, j] = path.position[:, j] - dict(term.shape).get(key, state.value(key)[j])
        return image


def _together(series: Sequence[JointImage], thin: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    return thin(np.stack([image for _, _, image in series])) if series else np.zeros((0, 0))
