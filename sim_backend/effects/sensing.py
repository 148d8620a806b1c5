"""Effects between a joint and what its encoder reports; compiled into the control callback, one joint and one step at a time."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np

from sim_backend.effects.effect import Acts, Effect, Group, Parameter, per_joint, per_robot

Numbers = TypeVar("Numbers", float, np.ndarray)


@numba.njit(inline="always")
def offset_position_rad(position_rad: float, offset_rad: float) -> float:
    """An encoder whose zero is off."""
    return position_rad + offset_rad


@numba.njit(inline="always")
def quantised(value: float, step: float) -> float:
    """A value in whole steps of an encoder."""
    if step == 0.0:
        return value
    return round(value / step) * step


@numba.njit(inline="always")
def filtered(previous: float, value: float, step_s: float, time_constant_s: float) -> float:
    """Next output of a first-order low-pass filter."""
    if time_constant_s == 0.0:
        return value
    return previous + step_s / (time_constant_s + step_s) * (value - previous)


@numba.njit(inline="always")
def noisy(value: float, std: Numbers, normal: Numbers) -> Numbers:
    """A value with an error, or many; ``normal`` is a standard normal number."""
    return value + std * normal  # pyrefly: ignore[bad-return] - as many as there are of the others


@numba.njit(inline="always")
def commanded_torque_nm(torque_nm: float, off: float) -> float:
    """Torque that a controller sends: none while it restarts."""
    return 0.0 if off > 0.0 else torque_nm


def _effect(
    name: str, about: str, source: str, apply: Callable[..., Any], *parameters: Parameter, group: Group = Group.SENSING
) -> Effect:
    return Effect(name, group, about, source, Acts.CONTROL, parameters, apply)


_BRRC = "noise that teams of the 2020 challenge trained with (cbschaff/benchmark-rrc domain_randomization.py)"

EFFECTS = (
    _effect(
        "encoder_offset",
        "the zero of a joint's encoder is off, as after homing against an end stop",
        "PACE (arXiv 2509.06342) fits encoder biases; robot_fingers homes against end stops",
        offset_position_rad,
        per_joint("offset_rad", "rad", -0.2, 0.2, 0.0, "measured minus true position"),
    ),
    _effect(
        "encoder_quantisation",
        "positions come in whole steps",
        "encoders of the finger modules count whole increments of the rotor",
        quantised,
        per_joint("step_rad", "rad", 0.0, 0.05, 0.0, "one step, at the joint"),
    ),
    _effect(
        "velocity_filter",
        "velocities come through a low-pass filter",
        "motor boards estimate speed from counts over a time and smooth it",
        filtered,
        per_joint("time_constant_s", "s", 0.0, 0.1, 0.0, "of the filter"),
    ),
    _effect(
        "joint_noise",
        "positions, velocities and torques are measured with an error of their own in every step",
        _BRRC,
        noisy,
        per_joint("position_rad", "rad", 0.0, 0.1, 0.0, "standard deviation"),
        per_joint("velocity_rad_s", "rad/s", 0.0, 1.0, 0.0, "standard deviation"),
        per_joint("torque_nm", "N m", 0.0, 0.1, 0.0, "standard deviation"),
    ),
    _effect(
        "joint_episode_noise",
        "positions and velocities are measured with an error that stays the same within a trial",
        "correlated observation noise of Dactyl (arXiv 1808.00177)",
        noisy,
        per_joint("position_rad", "rad", 0.0, 0.1, 0.0, "standard deviation over trials"),
        per_joint("velocity_rad_s", "rad/s", 0.0, 1.0, 0.0, "standard deviation over trials"),
    ),
    _effect(
        "encoder_jump",
        "an encoder loses counts",
        "a fault that the laboratory's self-test looks for (robot_fingers scripts/trifingerpro_post_submission.py)",
        offset_position_rad,
        per_joint("offset_rad", "rad", -3.2, 3.2, 0.0, "measured minus true position, on top of any other offset"),
        group=Group.FAULT,
    ),
    _effect(
        "controller_restart",
        "the controller restarts and sends no torque meanwhile",
        "robot_interfaces robot_backend.hpp: driver errors end a run",
        commanded_torque_nm,
        per_robot("off", "", 0.0, 1.0, 0.0, "above 0 while it restarts"),
        group=Group.FAULT,
    ),
)
