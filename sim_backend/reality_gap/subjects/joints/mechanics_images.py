"""What each effect adds to the mechanics and to the current of one episode: images of motors, of the clock and of bodies."""

from collections.abc import Callable, Sequence

import numpy as np

from sim_backend.reality_gap.subjects.joints import motor_law
from sim_backend.reality_gap.subjects.joints.body_law import BodyLaw
from sim_backend.reality_gap.subjects.joints.motor_torques import BEFORE_CURRENT, MotorTorques
from sim_backend.reality_gap.subjects.joints.state import CLOCK, SENSED, JointState, Term
from sim_backend.reality_gap.subjects.joints.trajectory import Trajectory

JointImage = tuple[int, int, np.ndarray]
"""Term, joint, and the term's image in that joint's equation at full rate, shape (s,)."""


class MechanicsImages:
    """Images along one episode of s samples and t rows.

    Args:
        path: the smoothed episode.
        motors: along it.
        body: effects on bodies along it.
        thin: takes series at full rate, shape (..., s), to rows, shape (..., t), as the residual was.
    """

    def __init__(
        self,
        path: Trajectory,
        motors: MotorTorques,
        body: BodyLaw,
        thin: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        self._path, self._motors, self._body, self._thin = path, motors, body, thin
        self._row_s = path.step_s * path.every

    def of(self, state: JointState, terms: Sequence[Term]) -> tuple[np.ndarray, list[JointImage]]:
        """Images in the mechanics, shape (t, k, m), and in the current."""
        images, currents = self._of_motors(state, terms)
        for i, term in enumerate(terms):
            if term.key not in (CLOCK, SENSED) and term.key not in motor_law.KEYS:
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
                torque = self._thin(np.stack([current for current, _, _ in base])).T  # friction goes by the encoders' clock
                images[:, :, i] = np.gradient(torque, self._row_s, axis=0)
            if term.key == SENSED and self._motors.measured_nm is not None:
                images[:, term.index, i] = self._thin(self._motors.measured_nm[term.index] - base[term.index][0])
        return images


def _together(series: Sequence[JointImage], thin: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    return thin(np.stack([image for _, _, image in series])) if series else np.zeros((0, 0))
