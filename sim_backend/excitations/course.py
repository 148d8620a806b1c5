"""Courses: commands on a grid of 10 ms that may depend on what a robot measured after the commands before."""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from sim_backend.driver.driver import Command
from sim_backend.trifinger import constants as c

COMMAND_STEPS = 10
COMMAND_S = COMMAND_STEPS * c.PHYSICS_STEP_S


@dataclass(frozen=True)
class Sight:
    """What one robot measured after a command: joints (9,) in rad, and the tracked cube, (3,) in m and (4,) wxyz."""

    joint_position_rad: np.ndarray
    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray


Course = Generator[tuple[Command, int], Sight, Sight | None]
"""Yields a command for one robot (n = 1) and its steps, is sent the sight after it, and returns the last sight."""


def commands(seconds: float) -> int:
    """How many commands fill a time."""
    return round(seconds / COMMAND_S)


def command_times_s(seconds: float) -> np.ndarray:
    """When the commands of a stretch begin, shape (k,), s."""
    return COMMAND_S * np.arange(commands(seconds))


def follow(position_target_rad: np.ndarray, desired_torque_nm: np.ndarray | None = None) -> Course:
    """One command after the other, whatever is seen.

    Args:
        position_target_rad: shape (k, 9), rad.
        desired_torque_nm: added to the torque of the position controller, shape (k, 9), N m; none if None.
    """
    if desired_torque_nm is None:
        desired_torque_nm = np.zeros_like(position_target_rad)
    sight = None
    for target, torque in zip(position_target_rad, desired_torque_nm, strict=True):
        sight = yield Command(torque[None].copy(), target[None].copy()), COMMAND_STEPS
    return sight


def eased(seconds: float) -> np.ndarray:
    """From just above 0 to 1 with minimal jerk, one number for each command, shape (k,)."""
    share = np.arange(1, commands(seconds) + 1) / commands(seconds)
    return share**3 * (10 - 15 * share + 6 * share**2)


def glide(start: np.ndarray, end: np.ndarray, seconds: float) -> np.ndarray:
    """Points from one to another with minimal jerk, without the first; shapes (m,), (m,) and (k, m)."""
    return start + eased(seconds)[:, None] * (end - start)


def hold(position_rad: np.ndarray, seconds: float) -> np.ndarray:
    """The same point for a while; shapes (m,) and (k, m)."""
    return np.repeat(position_rad[None], commands(seconds), axis=0)
