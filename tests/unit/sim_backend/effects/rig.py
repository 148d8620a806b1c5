"""A rig for effects: robots with given physics, driven by torques, with gravity off where it would be in the way."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sim_backend.driver.driver import Command, Segment, Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Effect
from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c

WEIGHTLESS = {"gravity.offset_m_s2": [[0.0, 0.0, 9.81]]}
UNDAMPED = {"safety_damping.factor": 0.0}
MID_RAD = np.tile([0.3, 0.8, -1.4], 3)
"""Fingers in the air, far from their limits, the table and the cube."""


def start_of(n: int = 1, *, joints: np.ndarray = MID_RAD, cube: tuple = (0.0, 0.0, 0.0325), first_seed: int = 1, **more) -> Start:
    quat = np.repeat([[1.0, 0.0, 0.0, 0.0]], n, axis=0)
    seeds = first_seed + np.arange(n)
    return Start(np.repeat(joints[None], n, axis=0), np.repeat([cube], n, axis=0), quat, noise_seed=seeds, **more)


def rig(values: Mapping[str, Any], n: int = 1, *, start: Start | None = None) -> SimulatedDriver:
    driver = SimulatedDriver(robots=n, physics=Physics.of(n, values))
    driver.reset(start or start_of(n))
    return driver


def run(driver: SimulatedDriver, torque_nm, steps: int) -> Segment:
    """A constant torque of shape () or (9,) for some steps."""
    torque = np.broadcast_to(np.asarray(torque_nm, dtype=float), (driver.robots, steps, 9))
    return driver.advance_torques(np.ascontiguousarray(torque))


def go_to(driver: SimulatedDriver, position_rad: np.ndarray, steps: int) -> Segment:
    target = np.broadcast_to(position_rad, (driver.robots, 9)).copy()
    return driver.advance([(Command(np.zeros((driver.robots, 9)), target), steps)])


def only(joint: int, torque_nm: float) -> np.ndarray:
    torque = np.zeros(9)
    torque[joint] = torque_nm
    return torque


def present(effect: Effect) -> dict[str, float]:
    """Values with which the effect is there: a third of the way from absent to the farther bound."""
    values = {}
    for parameter in effect.parameters:
        bound = max((parameter.lower, parameter.upper), key=lambda value: abs(value - parameter.absent))
        values[effect.key(parameter)] = parameter.absent + (bound - parameter.absent) / 3
    return values


__all__ = [
    "CATALOGUE",
    "MID_RAD",
    "UNDAMPED",
    "WEIGHTLESS",
    "c",
    "go_to",
    "only",
    "present",
    "rig",
    "run",
    "start_of",
]
