"""What drove joints before a window of a recording began: motors are as warm as it has made them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from sim_backend.reality_gap.knowledge.joint_effects import LIMITED_TORQUE, MOTOR_LOSS, MOTOR_RISE, MOTOR_WARMS_S
from sim_backend.reality_gap.subjects.joints.laws.state import JointState

_WARMING = (MOTOR_LOSS, MOTOR_RISE, MOTOR_WARMS_S, LIMITED_TORQUE)
"""What of a model says how warm its motors get."""


def warms(state: JointState) -> bool:
    """Whether it is of account in a model how warm its motors are."""
    return bool(state.value(MOTOR_LOSS).any())


def warming(state: JointState) -> bytes:
    """The same for models whose motors warm alike."""
    return b"".join(state.value(key).tobytes() for key in _WARMING)


@dataclass(frozen=True)
class Past:
    """What drove k joints in whole recordings, and where in them n windows begin.

    Attributes:
        driving_nm: of each recording, shapes (k, s).
        warmth_k: its motors' measured rises, shapes (k, s), NaN or None where there are none.
        step_s: between their samples.
        owner: recording of each window, shape (n,).
        first: its sample at which each window begins, shape (n,).
    """

    driving_nm: Sequence[np.ndarray]
    warmth_k: Sequence[np.ndarray | None]
    step_s: Sequence[float]
    owner: np.ndarray
    first: np.ndarray

    def some(self, index: np.ndarray) -> "Past":
        """Of some windows, by index."""
        return replace(self, owner=self.owner[index], first=self.first[index])

    def warm_k(self, state: JointState) -> np.ndarray:
        """How much warmer than their surroundings a model's motors begin windows, K, shape (n, k).

        As measured, else recordings begin cold.
        """
        found = np.zeros((len(self.owner), state.joints))
        for joint in np.flatnonzero(state.value(MOTOR_LOSS)):
            rise, time_s, limit_nm = (float(state.value(key)[joint]) for key in (MOTOR_RISE, MOTOR_WARMS_S, LIMITED_TORQUE))
            for recording, (torque_nm, step_s) in enumerate(zip(self.driving_nm, self.step_s, strict=True)):
                rows, measured = self.owner == recording, self.warmth_k[recording]
                if measured is not None and np.isfinite(measured[joint]).all():
                    found[rows, joint] = measured[joint, self.first[rows]]
                elif rows.any():
                    heats = rise * np.minimum(np.abs(np.nan_to_num(torque_nm[joint])), limit_nm) ** 2
                    kept = np.exp(-step_s / time_s)
                    warm = np.concatenate([[0.0], lfilter([1.0 - kept], [1.0, -kept], heats)])
                    found[rows, joint] = warm[self.first[rows]]
        return found
