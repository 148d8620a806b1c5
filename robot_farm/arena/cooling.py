"""How motors cool while a robot stands still between trials, and how long it waits before they get too hot."""

import numpy as np

from sim_backend.effects.physics import Physics

BETWEEN_TRIALS_S = 5.0
"""Simulated time in which the motors are off between two trials: results are handed in and the next lease is read."""
PAUSE_ABOVE_K = 30.0
"""A motor that is so much warmer than the room does not begin a trial. No source gives a limit for these motors. The shells that
hold them are printed, and PLA softens from 55 to 60 degrees on; this is 55 degrees in a room of 25, and a shell stays a few
degrees cooler than the motor in it."""
RESUME_BELOW_K = 20.0
"""To so much the pause lets the hottest motor cool."""
_TIME_CONSTANT = "thermal_derating.time_constant_s"


def pause_s(rise_k: np.ndarray, physics: Physics) -> float:
    """How long a robot waits before its next trial, besides the time between any two.

    Args:
        rise_k: temperature of each motor above ambient, shape (9,).
        physics: of the robot (n = 1), with the time constants of its motors.

    Returns:
        0 where no motor is above the limit, otherwise the time until all are cool enough, s.
    """
    if (rise_k <= PAUSE_ABOVE_K).all():
        return 0.0
    warm = np.maximum(rise_k / RESUME_BELOW_K, 1.0)
    return float((physics.value(_TIME_CONSTANT)[0] * np.log(warm)).max())


def cooled_k(rise_k: np.ndarray, physics: Physics, duration_s: float) -> np.ndarray:
    """Temperatures above ambient after motors were off for a time; shape (9,), K."""
    return rise_k * np.exp(-duration_s / physics.value(_TIME_CONSTANT)[0])
