"""What becomes torque while a robot moves: by a PD controller, a servo that drives its motor by voltage, or the motor alone.

All are one law: ``clip(stiffness (target - position) - damping velocity + desired, limit) - back_emf velocity``. Of a PD
controller nothing comes after the limit. A servo clips its duty before the motor's own voltage acts against it. With duty
``g (target - position)``, supply V, torque constant kt and resistance R its stiffness is ``kt V g / R``, its limit is
``kt V / R`` and its back-EMF ``kt^2 / R``. A motor whose voltage was recorded has no stiffness, but ``kt voltage / R`` desired.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
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
    """

    target_rad: np.ndarray
    stiffness_nm_rad: np.ndarray
    damping_nm_s_rad: np.ndarray
    limit_nm: np.ndarray
    back_emf_nm_s_rad: np.ndarray
    desired_nm: np.ndarray

    @property
    def is_known(self) -> np.ndarray:
        """Joints that it drives, shape (k,)."""
        return np.asarray(np.isfinite(self.stiffness_nm_rad).reshape(-1, self.stiffness_nm_rad.shape[-1]).any(axis=0))

    def torque_nm(self, position_rad: np.ndarray, velocity_rad_s: np.ndarray) -> np.ndarray:
        """Torque that is sent for the positions and velocities that are reported, of the law's shape."""
        asked = self.stiffness_nm_rad * (self.target_rad - position_rad) - self.damping_nm_s_rad * velocity_rad_s
        limited = np.clip(asked + self.desired_nm, -self.limit_nm, self.limit_nm)
        return limited - self.back_emf_nm_s_rad * velocity_rad_s

    def at(self, index: Any) -> "Feedback":
        """The law of some samples, as arrays are indexed."""
        return Feedback(*(getattr(self, field.name)[index] for field in fields(self)))

    @staticmethod
    def stacked(laws: Sequence["Feedback"]) -> "Feedback":
        """Laws of stretches of the same length, one above the other."""
        return Feedback(*(np.stack([getattr(law, field.name) for law in laws]) for field in fields(Feedback)))
