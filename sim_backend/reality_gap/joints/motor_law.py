"""The effects between a sent torque and a joint, applied along a recorded motion with the catalogue's own functions."""

import functools

import numba
import numpy as np
from numba import types  # pyright: ignore[reportPrivateImportUsage]

from sim_backend.driver.compilation import compiled_once
from sim_backend.effects.actuation import (
    backlash,
    cogging_torque_nm,
    derated_torque_nm,
    sagging_factor,
    saturated_torque_nm,
    scaled_torque_nm,
    temperature_rise_k,
)
from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.friction import directional_bound_nm, load_bound_nm, stribeck_bound_nm
from sim_backend.trifinger import constants as c

KEYS = (
    "action_delay.delay_s",
    "torque_saturation.limit_nm",
    "supply_sag.loss_per_nm",
    "torque_constant.error",
    "thermal_derating.loss_per_k",
    "thermal_derating.rise_k_nm2",
    "thermal_derating.time_constant_s",
    "cogging.amplitude_nm",
    "cogging.cycles_per_rad",
    "cogging.phase_rad",
    "backlash.gap_rad",
    "backlash.rotor_inertia_kg_m2",
    "coulomb_friction.torque_nm",
    "stribeck_friction.extra_nm",
    "stribeck_friction.speed_rad_s",
    "load_friction.coefficient",
    "directional_friction.difference_nm",
)
"""Parameters of one joint's motor and gear, in the order of the law's vector."""
UNLIMITED_NM = 1e9
"""Saturation of a model whose motors have none that is known."""
DIRECTION_RAD_S = 0.01
"""Within this speed the direction of friction blends over."""


def absent_values() -> np.ndarray:
    """A motor and gear without effects, shape (len(KEYS),)."""
    values = np.array([PARAMETERS[key].absent for key in KEYS])
    values[KEYS.index("torque_saturation.limit_nm")] = UNLIMITED_NM
    return values


def _law(sent, total, position, velocity, step_s, p, current, net, play):
    """One joint along a motion: what the motor's current gives, what is left at the joint, and the play of the gear."""
    steps = len(sent)
    whole = int(np.floor(p[0] / step_s + 1e-9))
    fraction = p[0] / step_s - whole
    warm, rotor, gap = 0.0, velocity[0], 0.0
    for i in range(steps):
        newer, older = sent[max(0, i - whole)], sent[max(0, i - whole - 1)]
        value = saturated_torque_nm(newer + fraction * (older - newer), p[1])
        if p[2] != 0.0:
            value = saturated_torque_nm(value, c.MAX_TORQUE_NM * sagging_factor(p[2], total[i]))
        current[i] = value
        if p[4] != 0.0:
            warm = temperature_rise_k(warm, value, p[5], p[6], step_s)
        value = derated_torque_nm(scaled_torque_nm(value, p[3]), warm, p[4])
        value += cogging_torque_nm(p[7], p[8], p[9], position[i])
        if p[10] > 0.0:
            gap, rotor, value = backlash(gap, rotor, velocity[i], value, p[10], p[11], step_s)
        play[i] = gap
        speed = velocity[i]
        bound = p[12] + stribeck_bound_nm(p[13], p[14], speed) + load_bound_nm(p[15], value)
        bound = max(0.0, bound + directional_bound_nm(p[16], speed))
        net[i] = value - bound * np.tanh(speed / DIRECTION_RAD_S)


@functools.cache
def _compiled():
    series = types.float64[:]
    signature = types.void(series, series, series, series, types.float64, series, series, series, series)
    return compiled_once(lambda cache: numba.njit(signature, cache=cache)(_law))


def along(
    sent_nm: np.ndarray, total_nm: np.ndarray, position: np.ndarray, velocity: np.ndarray, step_s: float, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The law along one joint's motion; all arrays contiguous, of floats.

    Args:
        sent_nm: torque sent in each step, shape (s,), N m.
        total_nm: of all motors together, shape (s,), N m.
        position: of the joint, shape (s,), rad.
        velocity: shape (s,), rad/s.
        step_s: length of a step.
        values: by ``KEYS``.

    Returns:
        Torque of the current (what a board measures), torque left at the joint after friction, and play, each (s,).
    """
    out = np.empty((3, len(sent_nm)))
    _compiled()(sent_nm, total_nm, position, velocity, step_s, values, *out)
    return out[0], out[1], out[2]
