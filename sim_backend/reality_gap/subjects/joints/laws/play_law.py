"""The play of a gear along a recorded motion: the encoder sits at the rotor, so that the link is where nobody measured it."""

import functools
from collections.abc import Callable

import numba
import numpy as np
from numba import types

from sim_backend.driver.compilation import compiled_once
from sim_backend.reality_gap.subjects.joints.laws.plant import InverseDynamics
from sim_backend.reality_gap.subjects.joints.laws.trajectory import Trajectory, filled_gaps

ROTOR_RAD, ROTOR_RAD_S, FALL_RAD_S2 = range(3)
"""Rows of the motion: rotor as reported, and what the link would do without its motor."""


def _follow(
    motion: np.ndarray, step_s: float, gap_rad: float, rotor_inertia_kg_m2: float, torque_nm: np.ndarray, play_rad: np.ndarray
) -> None:
    """The law, in place on the last two."""
    rotor, speed, fall = motion[0], motion[1], motion[2]
    half, steps = 0.5 * gap_rad, len(torque_nm)
    side, play, link = 0.0, 0.0, speed[0]
    for i in range(steps - 1):
        torque = torque_nm[i]
        if side == 0.0 or torque * side <= 0.0:
            if side != 0.0:
                side, link = 0.0, speed[i]
            free = speed[i] + step_s * torque / rotor_inertia_kg_m2
            play += rotor[i + 1] - rotor[i] - step_s * link
            link += step_s * fall[i]
            torque_nm[i] = 0.0
            if abs(play) >= half:
                side = 1.0 if play > 0.0 else -1.0
                play = side * half
                torque_nm[i] = rotor_inertia_kg_m2 * (free - link) / step_s
        play_rad[i] = play
    play_rad[steps - 1] = play


@functools.cache
def _compiled() -> Callable[..., None]:
    series, number = types.float64[::1], types.float64
    signature = types.void(types.float64[:, ::1], number, number, number, series, series)
    return compiled_once(lambda cache: numba.njit(signature, cache=cache)(_follow))


def follow_play(
    motion: np.ndarray, step_s: float, gap_rad: float, rotor_inertia_kg_m2: float, torque_nm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What passes through a gear with play, and the play; the law is the catalogue's ``backlash``.

    While the motor presses the rotor against a side all of its torque passes. A free rotor passes nothing, and its link falls;
    where they meet the link gets what the rotor was faster by. Of a light link only: a heavy one falls for so long that small
    errors of its fall decide when they meet.

    Args:
        motion: of one joint, as :func:`geared_motion` has it, shape (3, s).
        step_s: length of a step.
        gap_rad: width of the play.
        rotor_inertia_kg_m2: of the free rotor, on the joint's side.
        torque_nm: of the motor, shape (s,).

    Returns:
        Torque that passes, N m, and how far the rotor is ahead, rad, each (s,).
    """
    passed, play = np.array(torque_nm, dtype=float), np.zeros(len(torque_nm))
    _compiled()(np.ascontiguousarray(motion), step_s, gap_rad, rotor_inertia_kg_m2, passed, play)
    return passed, play


def geared_motion(path: Trajectory, dynamics: InverseDynamics) -> np.ndarray:
    """The motion of each of k joints as :func:`follow_play` takes it, shape (k, 3, s).

    Args:
        path: the smoothed episode, of s samples.
        dynamics: of the nominal model along it.
    """
    inertia = np.diagonal(dynamics.by_acceleration, axis1=1, axis2=2)
    fall = path.acceleration - dynamics.torque_nm / inertia
    position, speed = path.joints.position_rad, path.joints.velocity_rad_s
    motion = np.empty((position.shape[1], 3, len(position)))
    motion[:, ROTOR_RAD] = filled_gaps(position).T
    motion[:, ROTOR_RAD_S] = (path.fast_velocity if speed is None else filled_gaps(speed)).T
    motion[:, FALL_RAD_S2] = [np.interp(path.recording.time_s, path.time_s, column) for column in fall.T]
    return motion
