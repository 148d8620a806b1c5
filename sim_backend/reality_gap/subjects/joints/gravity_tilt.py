"""Gravity as a tilted table has it, turned by the catalogue's own function."""

import mujoco
import numpy as np

from sim_backend.effects.body import table_tilt

_STEP_RAD = 1e-4


def tilted_gravity(gravity_m_s2: np.ndarray, roll_rad: float, pitch_rad: float) -> np.ndarray:
    """Gravity in the frame of a tilted table, shape (3,), m/s^2."""
    spec = mujoco.MjSpec()
    spec.option.gravity = gravity_m_s2
    table_tilt(spec, {"roll_rad": roll_rad, "pitch_rad": pitch_rad})
    return np.array(spec.option.gravity)


def tilt_images(by_gravity: np.ndarray, gravity_m_s2: np.ndarray) -> np.ndarray:
    """What small tilts do to torques: by axes of gravity, shape (t, k, 3), to by roll and pitch, shape (t, k, 2), N m/rad."""
    changes = [
        (tilted_gravity(gravity_m_s2, roll_rad, pitch_rad) - gravity_m_s2) / _STEP_RAD
        for roll_rad, pitch_rad in ((_STEP_RAD, 0.0), (0.0, _STEP_RAD))
    ]
    return np.stack([by_gravity @ change for change in changes], axis=2)
