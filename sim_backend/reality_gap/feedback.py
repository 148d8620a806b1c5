"""What becomes torque while a robot moves: by a PD controller, a servo that drives its motor by voltage, or the motor alone.

All are one law: ``clip(stiffness (target - position) - damping velocity + desired, limit) - back_emf velocity``. Of a PD
controller nothing comes after the limit. A servo clips its duty before the motor's own voltage acts against it. With duty
``g (target - position)``, supply V, torque constant kt and resistance R its stiffness is ``kt V g / R``, its limit is
``kt V / R`` and its back-EMF ``kt^2 / R``. A motor whose voltage was recorded has no stiffness, but ``kt voltage / R`` desired.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Feedback:
    """The law of k joints over s samples, shapes (s, k), or (n, s, k) for n stretches; NaN for joints of which none is known.

    Attributes:
        target_rad: what a joint is to be at.
        stiffness_nm_rad, damping_nm_s_rad: gains.
        limit_nm: of what the gains ask for; infinite without one.
        back_emf_nm_s_rad: torque that is lost for each rad/s, after the limit.
        desired_nm: torque that is added before the limit.
        on_board: 1 where the law runs beside the motor, so that targets and desired torques are what a delay makes late; 0 where
            the law runs before the delay, which makes its torque late.
    """

    target_rad: np.ndarray
    stiffness_nm_rad: np.ndarray
    damping_nm_s_rad: np.ndarray
    limit_nm: np.ndarray
    back_emf_nm_s_rad: np.ndarray
    desired_nm: np.ndarray
    on_board: np.ndarray

    @property
    def is_known(self) -> np.ndarray:
        """Joints that it drives, shape (k,)."""
        return np.asarray(np.isfinite(self.stiffness_nm_rad).reshape(-1, self.stiffness_nm_rad.shape[-1]).any(axis=0))

    @property
    def is_on_board(self) -> np.ndarray:
        """Joints whose law runs beside their motors, shape (k,)."""
        return np.asarray((np.nan_to_num(self.on_board) > 0.5).reshape(-1, self.on_board.shape[-1]).any(axis=0))

    def torque_nm(self, position_rad: np.ndarray, velocity_rad_s: np.ndarray) -> np.ndarray:
        """Torque that is sent for the positions and velocities that are reported, of the law's shape."""
        asked = self.stiffness_nm_rad * (self.target_rad - position_rad) - self.damping_nm_s_rad * velocity_rad_s
        limited = np.clip(asked + self.desired_nm, -self.limit_nm, self.limit_nm)
        return limited - self.back_emf_nm_s_rad * velocity_rad_s

    def without(self, joints: Sequence[bool]) -> "Feedback":
        """The same but for joints of which none is known any more, a truth value for each joint."""
        return Feedback(*(np.where(joints, np.nan, getattr(self, field.name)) for field in fields(self)))

    def at(self, index: Any) -> "Feedback":
        """The law of some samples, as arrays are indexed."""
        return Feedback(*(getattr(self, field.name)[index] for field in fields(self)))

    def of_step(self, sample: int, at: np.ndarray, lasts: float) -> "Feedback":
        """The law of a step, arrays (n, k), with what has come by it of targets and desired torques: means over the step.

        Both are held from sample to sample; the first and the last one go on.

        Args:
            sample: in which the step is.
            at: when what comes at its begin was sent, in samples, shape (n, k).
            lasts: how long the step is, in samples.
        """
        last = self.target_rad.shape[1] - 1
        first, second = (np.clip(np.floor(edge), 0, last).astype(int)[:, None] for edge in (at + 1e-9, at + lasts - 1e-9))
        share = np.where(first == second, 1.0, (at + lasts)[:, None] - second) / np.where(first == second, 1.0, lasts)

        def arriving(held: np.ndarray) -> np.ndarray:
            older, newest = (np.take_along_axis(held, index, axis=1) for index in (first, second))
            return np.where(first == second, newest, share * newest + (1.0 - share) * older)[:, 0]

        law = self.at((slice(None), sample))
        return replace(law, target_rad=arriving(self.target_rad), desired_nm=arriving(self.desired_nm))

    @staticmethod
    def stacked(laws: Sequence["Feedback"]) -> "Feedback":
        """Laws of stretches of the same length, one above the other."""
        return Feedback(*(np.stack([getattr(law, field.name) for law in laws]) for field in fields(Feedback)))
