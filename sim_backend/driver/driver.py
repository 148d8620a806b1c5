"""What stands between a control step and a robot, simulated or real.

What is made anew in each control period is a named tuple: a frozen dataclass sets each of its fields by a call of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np


class Command(NamedTuple):
    """What a policy asks of n robots until the next command.

    ``desired_torque_nm`` has shape (n, 9) in N m; ``position_target_rad`` has shape (n, 9) in rad, or is None for a command
    without a position part.
    """

    desired_torque_nm: np.ndarray
    position_target_rad: np.ndarray | None = None


@dataclass(frozen=True)
class Start:
    """Where n robots and cubes are when a trial begins, at rest unless velocities are given.

    Shapes (n, 9) in rad, (n, 3) in m and (n, 4) wxyz; velocities (n, 9) in rad/s and, of the cube, (n, 6): m/s in the world's
    frame, then rad/s in the cube's. ``noise_seed`` (n,) seeds everything random about the robots (whole
    numbers below 2**53, 0 if None); ``motor_temperature_rise_k`` (n, 9) is above ambient, cold if None.
    """

    joint_position_rad: np.ndarray
    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray
    noise_seed: np.ndarray | None = None
    motor_temperature_rise_k: np.ndarray | None = None
    joint_velocity_rad_s: np.ndarray | None = None
    cube_velocity: np.ndarray | None = None


class Segment(NamedTuple):
    """Everything that happened in a stretch of physics steps, for n robots.

    Row k is the state *before* step k together with the torque that acted during step k. Shapes (n, steps, 9) in rad, rad/s
    and N m, (n, steps, 3) in m, (n, steps, 4) wxyz. ``first_step`` is the number of the first row since the trial's start.
    Joint positions, velocities and ``measured_torque_nm`` are what the robot reports; desired is what was asked, applied what
    the driver sent to the motors. True states, ``effective_torque_nm`` (what reached the joints before friction) and the cube's
    poses are known to a simulation only. Without effects measured and true are the same arrays.
    """

    first_step: int
    joint_position_rad: np.ndarray
    joint_velocity_rad_s: np.ndarray
    measured_torque_nm: np.ndarray
    desired_torque_nm: np.ndarray
    applied_torque_nm: np.ndarray
    effective_torque_nm: np.ndarray
    true_joint_position_rad: np.ndarray
    true_joint_velocity_rad_s: np.ndarray
    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray


class Measurement(NamedTuple):
    """What n robots measure now. Shapes (n, 9) in rad, rad/s and N m.

    Known to a simulation only: true joint states (n, 9) and the cube's pose, (n, 3) in m and (n, 4) wxyz.
    ``fingertip_force`` (n, 3) is what the push sensors in the tips show, 0 to 1 and no unit; None where nobody asked.
    """

    joint_position_rad: np.ndarray
    joint_velocity_rad_s: np.ndarray
    joint_torque_nm: np.ndarray
    true_joint_position_rad: np.ndarray
    true_joint_velocity_rad_s: np.ndarray
    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray
    fingertip_force: np.ndarray | None = None


class Driver(Protocol):
    """A robot as a control step sees it."""

    def reset(self, start: Start, robots: np.ndarray | None = None) -> None:
        """Bring robots and cubes to their start: all of them, or those whose indices are given, one row each."""
        ...

    def measure(self, *, feel: bool = False) -> Measurement:
        """The present state; with ``feel`` the fingertips' forces, too."""
        ...

    def advance(self, schedule: Sequence[tuple[Command, int]]) -> Segment:
        """Apply commands one after the other, each for a number of steps of 1 ms."""
        ...


def hold_command(joint_position_rad: np.ndarray) -> Command:
    """The idle action after initialisation: hold a position of shape (n, 9), rad (robot_fingers, CHANGELOG)."""
    return Command(np.zeros_like(joint_position_rad), joint_position_rad)
