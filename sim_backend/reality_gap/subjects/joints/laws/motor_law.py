"""The effects between a sent torque and a joint, applied along a recorded motion with the catalogue's own functions."""

import functools
from collections.abc import Callable

import numba
import numpy as np
from numba import types

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
from sim_backend.reality_gap.knowledge.unnamed_laws import DRAG, ZERO
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
    "stribeck_friction.exponent",
    "load_friction.coefficient",
    "load_friction.external_coefficient",
    "directional_friction.difference_nm",
)
"""Parameters of one joint's motor and gear, in the order of the law's vector."""
VECTOR = (*KEYS, ZERO, DRAG)
"""With laws that the catalogue lacks."""
_DELAY = KEYS.index("action_delay.delay_s")
_LIMIT = KEYS.index("torque_saturation.limit_nm")
SAG = KEYS.index("supply_sag.loss_per_nm")
"""Where the vector has the sag of a supply, which lets motors feel each other."""
_CONSTANT = KEYS.index("torque_constant.error")
_LOSS = KEYS.index("thermal_derating.loss_per_k")
_RISE = KEYS.index("thermal_derating.rise_k_nm2")
_WARM_TIME = KEYS.index("thermal_derating.time_constant_s")
_AMPLITUDE = KEYS.index("cogging.amplitude_nm")
_CYCLES = KEYS.index("cogging.cycles_per_rad")
_PHASE = KEYS.index("cogging.phase_rad")
PLAY, ROTOR = (KEYS.index(f"backlash.{name}") for name in ("gap_rad", "rotor_inertia_kg_m2"))
"""Where the vector has the play of a gear and the inertia of its rotor."""
_COULOMB = KEYS.index("coulomb_friction.torque_nm")
_STRIBECK = KEYS.index("stribeck_friction.extra_nm")
_STRIBECK_SPEED = KEYS.index("stribeck_friction.speed_rad_s")
_STRIBECK_EXPONENT = KEYS.index("stribeck_friction.exponent")
_LOAD = KEYS.index("load_friction.coefficient")
_OUTER_LOAD = KEYS.index("load_friction.external_coefficient")
_DIRECTION = KEYS.index("directional_friction.difference_nm")
_ZERO, _DRAG = VECTOR.index(ZERO), VECTOR.index(DRAG)
_FORMS = ((_AMPLITUDE, (_CYCLES, _PHASE)), (_STRIBECK, (_STRIBECK_SPEED, _STRIBECK_EXPONENT)), (_DIRECTION, ()))
"""Of ``along_one_nm`` the size without which there is nothing, and what else each depends on."""
_FORMS_KEPT = 2
FRICTION = tuple(KEYS[i] for i in (_COULOMB, _STRIBECK, _LOAD, _OUTER_LOAD, _DIRECTION))
"""Numbers without which a joint has no dry friction."""
LIMIT, COGGING, GAP = KEYS[_LIMIT], KEYS[_AMPLITUDE], KEYS[PLAY]
"""A motor's largest torque; the numbers whose images are not a difference of two torques."""
ROTOR_INERTIA_KG_M2 = PARAMETERS[KEYS[ROTOR]].absent
"""Of a nominal rotor, on the joint's side."""
UNLIMITED_NM = 1e9
"""Saturation of a model whose motors have none that is known."""
_AS_LARGE = 1.25
"""Times a friction that what differs between its directions may be."""
DIRECTION_RAD_S = 0.01
"""Within this speed the direction of friction blends over."""


Values = tuple[float, ...]
"""Of one joint, by ``VECTOR``."""


def absent_values() -> np.ndarray:
    """A motor and gear without effects, shape (len(VECTOR),)."""
    return np.array(_absent())


@functools.cache
def _absent() -> Values:
    """Read from the catalogue once: a fit asks for it with every model."""
    of_catalogue = tuple(PARAMETERS[key].absent if key in PARAMETERS else 0.0 for key in VECTOR)
    return (*of_catalogue[:_LIMIT], UNLIMITED_NM, *of_catalogue[_LIMIT + 1 :])


def pushes(values: np.ndarray) -> bool:
    """Whether friction of one joint, without load and fast, would be clearly less than none in one direction.

    It is none there, where both are as large; and neither is known better than within a share.
    """
    return bool(abs(values[_DIRECTION]) > _AS_LARGE * values[_COULOMB])


def needs_external(values: np.ndarray) -> bool:
    """Whether the law of one joint asks for its load from outside."""
    return bool(values[_OUTER_LOAD] != 0.0)


def direction_of(velocity: np.ndarray) -> np.ndarray:
    """Sign of velocities in rad/s that friction is against, blending over near standstill; any shape."""
    return np.tanh(velocity / DIRECTION_RAD_S)


def in_time(values: np.ndarray) -> tuple[float, np.ndarray]:
    """The delay among a joint's values, s, and the values without it."""
    prompt = values.copy()
    prompt[_DELAY] = 0.0
    return float(values[_DELAY]), prompt


@numba.njit
def values_of(p: np.ndarray, j: int) -> Values:
    """Row j of values by ``VECTOR``, shape (k, len(VECTOR)): numbers that stay in registers take a sixth of an array's time."""
    # fmt: off
    return (
        p[j, 0], p[j, 1], p[j, 2], p[j, 3], p[j, 4], p[j, 5], p[j, 6], p[j, 7], p[j, 8], p[j, 9],
        p[j, 10], p[j, 11], p[j, 12], p[j, 13], p[j, 14], p[j, 15], p[j, 16], p[j, 17], p[j, 18], p[j, 19],
        p[j, 20],
    )
    # fmt: on


@numba.njit(inline="always")
def along_one_nm(p: Values, position: float, velocity: float) -> tuple[float, float, float]:
    """What cogging, friction near standstill and what differs between directions come to for each N m; 0 without them.

    They follow from the motion and the law's form alone, and take most of its time.
    """
    cogging = cogging_torque_nm(1.0, p[_CYCLES], p[_PHASE], position) if p[_AMPLITUDE] != 0.0 else 0.0
    standstill = stribeck_bound_nm(1.0, p[_STRIBECK_SPEED], p[_STRIBECK_EXPONENT], velocity) if p[_STRIBECK] != 0.0 else 0.0
    return cogging, standstill, directional_bound_nm(1.0, velocity) if p[_DIRECTION] != 0.0 else 0.0


@numba.njit(inline="always")
def sent_to_joint(
    sent: float,
    total: float,
    velocity: float,
    external: float,
    step_s: float,
    p: Values,
    one_nm: tuple[float, float, float],
    warm: float,
    rotor: float,
    play: float,
) -> tuple[float, float, float, float, float, float]:
    """One step of a joint: torque of the current, torque after the gear, bound of the friction, and what the joint remembers.

    ``p`` has its values by ``VECTOR``, ``one_nm`` is that of :func:`along_one_nm`. It remembers the motor's temperature, the
    rotor's speed and the play.
    """
    cogging, standstill, directed = one_nm
    current = saturated_torque_nm(sent, p[_LIMIT])
    if p[SAG] != 0.0:
        current = saturated_torque_nm(current, c.MAX_TORQUE_NM * sagging_factor(p[SAG], total))
    if p[_LOSS] != 0.0:
        warm = temperature_rise_k(warm, current, p[_RISE], p[_WARM_TIME], step_s)
    value = derated_torque_nm(scaled_torque_nm(current, p[_CONSTANT]), warm, p[_LOSS])
    value += p[_AMPLITUDE] * cogging
    value += p[_ZERO] - p[_DRAG] * velocity * abs(velocity)
    if p[PLAY] > 0.0:
        play, rotor, value = backlash(play, rotor, velocity, value, p[PLAY], p[ROTOR], step_s)
    bound = p[_COULOMB] + p[_STRIBECK] * standstill + load_bound_nm(p[_LOAD], value, p[_OUTER_LOAD], external)
    return current, value, max(0.0, bound + p[_DIRECTION] * directed), warm, rotor, play


def _law(
    sent: np.ndarray,
    total: np.ndarray,
    velocity: np.ndarray,
    direction: np.ndarray,
    cogging: np.ndarray,
    standstill: np.ndarray,
    directed: np.ndarray,
    external: np.ndarray,
    measured_k: np.ndarray,
    step_s: float,
    p: np.ndarray,
    current: np.ndarray,
    net: np.ndarray,
    play: np.ndarray,
) -> None:
    """One joint along a motion: what the motor's current gives, what is left at the joint, and the play of the gear."""
    whole = int(np.floor(p[0, _DELAY] / step_s + 1e-9))
    fraction = p[0, _DELAY] / step_s - whole
    values, warm, rotor, gap = values_of(p, 0), 0.0, velocity[0], 0.0
    for i in range(len(sent)):
        newer, older = sent[max(0, i - whole)], sent[max(0, i - whole - 1)]
        arrived, speed = newer + fraction * (older - newer), velocity[i]
        if not np.isnan(measured_k[i]):
            warm = measured_k[i]
        one_nm = cogging[i], standstill[i], directed[i]
        now = sent_to_joint(arrived, total[i], speed, external[i], step_s, values, one_nm, warm, rotor, gap)
        current[i], value, bound, warm, rotor, gap = now
        play[i] = gap
        net[i] = value - bound * direction[i]


def _in_simulations(
    arrived: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    external: np.ndarray,
    step_s: float,
    p: np.ndarray,
    memory: np.ndarray,
    value: np.ndarray,
    bound: np.ndarray,
) -> None:
    """One step of k joints in n simulations; shapes (n, k), of ``p`` (n, k, len(VECTOR)) and of ``memory`` (n, k, 3)."""
    for i in range(arrived.shape[0]):
        total = np.abs(arrived[i]).sum()
        for j in range(arrived.shape[1]):
            values, warm, rotor, gap = values_of(p[i], j), memory[i, j, 0], memory[i, j, 1], memory[i, j, 2]
            speed, load = velocity[i, j], external[i, j]
            one_nm = along_one_nm(values, position[i, j], speed)
            now = sent_to_joint(arrived[i, j], total, speed, load, step_s, values, one_nm, warm, rotor, gap)
            _, value[i, j], bound[i, j], memory[i, j, 0], memory[i, j, 1], memory[i, j, 2] = now


@functools.cache
def _compiled() -> Callable[..., None]:
    series = types.float64[:]
    given, found = (series,) * 9, (series,) * 3
    signature = types.void(*given, types.float64, types.float64[:, ::1], *found)
    return compiled_once(lambda cache: numba.njit(signature, cache=cache)(_law))


@functools.cache
def in_simulations() -> Callable[..., None]:
    """One step of k joints in n simulations, compiled: torque after the gears and bounds of friction are filled in.

    Its arguments are those of ``_in_simulations``: torques that arrive at the motors, positions, velocities, and torques that
    gravity and motion ask of the joints, shape (n, k), the step, values by ``VECTOR``, shape (n, k, len(VECTOR)), memory of
    motors and gears, shape (n, k, 3), and the two results, (n, k).
    """
    rows, cubes = types.float64[:, ::1], types.float64[:, :, ::1]
    signature = types.void(rows, rows, rows, rows, types.float64, cubes, cubes, rows, rows)
    return compiled_once(lambda cache: numba.njit(signature, cache=cache)(_in_simulations))


@functools.cache
def _compiled_shape() -> Callable[..., None]:
    series = types.float64[:]
    signature = types.void(types.float64[:, ::1], series, series, types.int64, series)
    return compiled_once(lambda cache: numba.njit(signature, cache=cache)(_shape))


def _shape(p: np.ndarray, position: np.ndarray, velocity: np.ndarray, which: int, found: np.ndarray) -> None:
    """One of those of ``along_one_nm`` along a motion."""
    values = values_of(p, 0)
    for i in range(len(position)):
        found[i] = along_one_nm(values, position[i], velocity[i])[which]


class JointMotion:
    """The recorded motion of one joint, and what the law makes of it alone.

    Args:
        position: shape (s,), rad.
        velocity: shape (s,), rad/s.
    """

    def __init__(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.position, self.velocity = np.ascontiguousarray(position), np.ascontiguousarray(velocity)
        self.direction = direction_of(self.velocity)
        """Of the velocity (:func:`direction_of`), shape (s,)."""
        self._none = np.zeros(self.position.shape)
        self._known: list[dict[bytes, np.ndarray]] = [{} for _ in _FORMS]
        """Of each form the two that were asked for last, the latest at the end: most questions leave it as it is."""

    def shapes(self, values: np.ndarray) -> list[np.ndarray]:
        """What cogging, friction near standstill and what differs between directions come to for each N m, each (s,)."""
        return [
            self._none if values[size] == 0.0 else self._of(which, values[list(form)].tobytes(), values)
            for which, (size, form) in enumerate(_FORMS)
        ]

    def _of(self, which: int, form: bytes, values: np.ndarray) -> np.ndarray:
        known = self._known[which]
        found = known.pop(form, None)
        if found is None:
            alone, found = absent_values(), np.empty(self.position.shape)
            size, shape = _FORMS[which]
            alone[[size, *shape]] = values[[size, *shape]]
            _compiled_shape()(alone[None], self.position, self.velocity, which, found)
            if len(known) == _FORMS_KEPT:
                del known[next(iter(known))]
        known[form] = found
        return found


def along(
    sent_nm: np.ndarray,
    total_nm: np.ndarray,
    motion: JointMotion,
    external_nm: np.ndarray,
    measured_k: np.ndarray,
    step_s: float,
    values: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The law along one joint's motion; all arrays contiguous, of floats.

    Args:
        sent_nm: torque sent in each step, shape (s,), N m.
        total_nm: of all motors together, shape (s,), N m.
        motion: of the joint, s samples.
        external_nm: what gravity and motion ask of the joint, shape (s,), N m; anything where :func:`needs_external` is false.
        measured_k: how much warmer than its surroundings the motor was, shape (s,), K; NaN where the law says so, from cold.
        step_s: length of a step.
        values: by ``VECTOR``.

    Returns:
        Torque of the current (what a board measures), torque left at the joint after friction, and play, each (s,).
    """
    out = np.empty((3, len(sent_nm)))
    given = sent_nm, total_nm, motion.velocity, motion.direction, *motion.shapes(values), external_nm, measured_k
    _compiled()(*given, step_s, np.ascontiguousarray(values)[None], *out)
    return out[0], out[1], out[2]


def cogging_image(values: np.ndarray, position: np.ndarray) -> np.ndarray:
    """What cogging of a motor's own cycles and phase takes away per N m of its amplitude, shape (s,)."""
    return -np.sin(2.0 * np.pi * values[_CYCLES] * position + values[_PHASE])
