"""What happens in one step between a desired torque and the joints, compiled: measure, hold, protect, delay, drive, rub, push.

All functions work on the slots of one simulation (``effects/record.py``). With every effect absent the applied torque is
that of the safety pipeline, bit for bit, and nothing else acts.
"""

import math

import numba
import numpy as np

from sim_backend.driver.joint_reports import (
    filtered_velocity_rad_s,
    measured_position_rad,
    measured_torque_nm,
    measured_velocity_rad_s,
)
from sim_backend.driver.safety import joint_applied_torque_nm
from sim_backend.effects import record as r
from sim_backend.effects.actuation import (
    backlash,
    cogging_torque_nm,
    correlated_noise,
    delayed_torque_nm,
    derated_torque_nm,
    sagging_factor,
    saturated_torque_nm,
    scaled_gain,
    scaled_torque_nm,
    share_of_step,
    temperature_rise_k,
)
from sim_backend.effects.contact import push_force_n
from sim_backend.effects.friction import directional_bound_nm, load_bound_nm, stribeck_bound_nm, stuck_bound_nm
from sim_backend.effects.noise import gaussian, uniform
from sim_backend.effects.record import SLOTS
from sim_backend.effects.sensing import commanded_torque_nm
from sim_backend.trifinger import constants as c

_LOWER, _UPPER = tuple(c.SOFT_LIMIT_LOWER_RAD), tuple(c.SOFT_LIMIT_UPPER_RAD)
_KP, _KD = tuple(c.POSITION_GAIN_NM_RAD), tuple(c.VELOCITY_GAIN_NM_S_RAD)
_DAMPING, _LIMIT = tuple(c.SAFETY_DAMPING_NM_S_RAD), c.MAX_TORQUE_NM

_JITTER, _OFF = SLOTS["timing_jitter.std_s"], SLOTS["controller_restart.off"]
_STIFFNESS, _SAFETY = SLOTS["position_gain.factor"], SLOTS["safety_damping.factor"]
_DELAY, _CONSTANT = SLOTS["action_delay.delay_s"], SLOTS["torque_constant.error"]
_WHITE, _SLOW = SLOTS["action_noise.white_nm"], SLOTS["action_noise.correlated_nm"]
_RELATIVE = SLOTS["action_noise.relative"]
_HOLD, _SLOW_TIME = SLOTS["action_noise.hold_s"], SLOTS["action_noise.time_constant_s"]
_SATURATION, _SAG = SLOTS["torque_saturation.limit_nm"], SLOTS["supply_sag.loss_per_nm"]
_LOSS, _RISE = SLOTS["thermal_derating.loss_per_k"], SLOTS["thermal_derating.rise_k_nm2"]
_WARM_TIME = SLOTS["thermal_derating.time_constant_s"]
_COGGING, _CYCLES, _PHASE = (SLOTS[f"cogging.{name}"] for name in ("amplitude_nm", "cycles_per_rad", "phase_rad"))
_GAP, _ROTOR_INERTIA = SLOTS["backlash.gap_rad"], SLOTS["backlash.rotor_inertia_kg_m2"]
_COULOMB = SLOTS[r.COULOMB]
_LOAD, _OUTER_LOAD = SLOTS["load_friction.coefficient"], SLOTS["load_friction.external_coefficient"]
_STRIBECK, _STRIBECK_SPEED = SLOTS["stribeck_friction.extra_nm"], SLOTS["stribeck_friction.speed_rad_s"]
_STRIBECK_EXPONENT = SLOTS["stribeck_friction.exponent"]
_DIRECTION, _STUCK = SLOTS["directional_friction.difference_nm"], SLOTS["stuck_joint.holding_torque_nm"]
_PUSH, _PUSH_CHANCE = SLOTS["cube_pushes.force_n"], SLOTS["cube_pushes.probability"]
_PUSH_TIME = SLOTS["cube_pushes.duration_s"]


@numba.njit
def hold_late_command(slots: np.ndarray, torque: np.ndarray) -> None:
    """Timing jitter: let the previous command act until the new one has come; shape (9,).

    A command that is overtaken by a newer one hands on its time: the newest acts when the first of them was due.
    """
    if slots[_JITTER] == 0.0:
        for j in range(9):
            slots[r.HELD_TORQUE + j] = torque[j]
            slots[r.HELD_TARGET + j] = slots[r.POSITION_TARGET + j]
        return
    now_s, step_s = slots[r.CLOCK] * slots[r.STEP_S], slots[r.STEP_S]
    _let_come(slots, share_of_step(now_s, slots[r.DUE_S], step_s))
    is_new = False
    for j in range(9):
        target, awaited = slots[r.POSITION_TARGET + j], slots[r.AWAITED_TARGET + j]
        if torque[j] != slots[r.AWAITED_TORQUE + j] or (target != awaited and not (math.isnan(target) and math.isnan(awaited))):
            is_new = True
    if is_new:
        due_s = now_s + slots[_JITTER] * abs(gaussian(slots[r.SEED], slots[r.CLOCK], r.CHANNEL_LATENESS))
        slots[r.DUE_S] = min(due_s, slots[r.DUE_S]) if slots[r.DUE_S] > now_s else due_s
        for j in range(9):
            slots[r.AWAITED_TORQUE + j] = torque[j]
            slots[r.AWAITED_TARGET + j] = slots[r.POSITION_TARGET + j]
        _let_come(slots, share_of_step(now_s, slots[r.DUE_S], step_s))


@numba.njit
def _let_come(slots: np.ndarray, share: float) -> None:
    """Let the awaited command act for a share of this step: the torque as its mean, a position target if for half of it."""
    if share <= 0.0:
        return
    for j in range(9):
        held, awaited = slots[r.HELD_TORQUE + j], slots[r.AWAITED_TORQUE + j]
        slots[r.HELD_TORQUE + j] = awaited if share >= 1.0 else held + share * (awaited - held)
        if share >= 0.5:
            slots[r.HELD_TARGET + j] = slots[r.AWAITED_TARGET + j]


@numba.njit
def protect_nominal(slots: np.ndarray, torque: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> None:
    """The safety pipeline of a robot without effects, in place; shapes (9,)."""
    for j in range(9):
        torque[j] = joint_applied_torque_nm(
            torque[j],
            slots[r.POSITION_TARGET + j],
            position[j],
            velocity[j],
            _LOWER[j],
            _UPPER[j],
            _KP[j],
            _KD[j],
            _DAMPING[j],
            _LIMIT,
        )


@numba.njit
def protect(slots: np.ndarray, torque: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> None:
    """The safety pipeline in place, on what the encoders report; shapes (9,)."""
    for j in range(9):
        sent = joint_applied_torque_nm(
            slots[r.HELD_TORQUE + j],
            slots[r.HELD_TARGET + j],
            position[j],
            velocity[j],
            _LOWER[j],
            _UPPER[j],
            scaled_gain(_KP[j], slots[_STIFFNESS + j]),
            _KD[j],
            scaled_gain(_DAMPING[j], slots[_SAFETY + j]),
            _LIMIT,
        )
        torque[j] = commanded_torque_nm(sent, slots[_OFF])


@numba.njit
def delay(slots: np.ndarray, torque: np.ndarray, arrived: np.ndarray) -> None:
    """Put the torque sent into the ring and take out what arrives now; shapes (9,), the ring takes the rest of the slots."""
    length = (len(slots) - r.RING) // 9
    clock = int(slots[r.CLOCK])
    now = r.RING + 9 * (clock % length)
    for j in range(9):
        slots[now + j] = torque[j]
        if slots[_DELAY + j] == 0.0:
            arrived[j] = torque[j]
            continue
        steps = slots[_DELAY + j] / slots[r.STEP_S]
        whole: int = math.floor(steps + 1e-9)
        fraction = steps - whole if steps - whole > 1e-6 else 0.0
        newer, older = (clock - whole) % length, (clock - whole - 1) % length
        arrived[j] = delayed_torque_nm(slots[r.RING + 9 * newer + j], slots[r.RING + 9 * older + j], fraction)


@numba.njit
def add_noise(slots: np.ndarray, torque: np.ndarray) -> None:
    """Noise of the motors' currents, in place; shape (9,). White numbers that change within a step act by their mean."""
    seed, clock, step_s = slots[r.SEED], slots[r.CLOCK], slots[r.STEP_S]
    block = math.floor(clock * step_s / slots[_HOLD] + 1e-9)
    mean = math.sqrt(min(1.0, slots[_HOLD] / step_s))
    for j in range(9):
        if slots[_WHITE + j] != 0.0:
            torque[j] += mean * slots[_WHITE + j] * gaussian(seed, block, r.CHANNEL_WHITE + j)
        if slots[_RELATIVE + j] != 0.0:
            torque[j] *= 1.0 + mean * slots[_RELATIVE + j] * gaussian(seed, block, r.CHANNEL_RELATIVE + j)
        if slots[_SLOW + j] != 0.0:
            fresh = gaussian(seed, clock, r.CHANNEL_CORRELATED + j)
            kept = correlated_noise(slots[r.CORRELATED + j], fresh, step_s, slots[_SLOW_TIME]) if clock > 0.0 else fresh
            slots[r.CORRELATED + j] = kept
            torque[j] += slots[_SLOW + j] * kept


@numba.njit
def limit(slots: np.ndarray, torque: np.ndarray) -> None:
    """What motors and supply give of it, in place; shape (9,)."""
    total = 0.0
    for j in range(9):
        torque[j] = saturated_torque_nm(torque[j], slots[_SATURATION + j])
        total += abs(torque[j])
    if slots[_SAG] != 0.0:
        left_nm = _LIMIT * sagging_factor(slots[_SAG], total)
        for j in range(9):
            torque[j] = saturated_torque_nm(torque[j], left_nm)


@numba.njit
def drive(slots: np.ndarray, torque: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> None:
    """From the motors' currents, as torque, to the torque at the joints, in place; true states, shapes (9,)."""
    step_s = slots[r.STEP_S]
    for j in range(9):
        value, warm = torque[j], r.TEMPERATURE + j
        slots[warm] = temperature_rise_k(slots[warm], value, slots[_RISE + j], slots[_WARM_TIME + j], step_s)
        value = derated_torque_nm(scaled_torque_nm(value, slots[_CONSTANT + j]), slots[warm], slots[_LOSS + j])
        rotor_rad = position[j] + slots[r.PLAY + j]
        value += cogging_torque_nm(slots[_COGGING + j], slots[_CYCLES + j], slots[_PHASE + j], rotor_rad)
        if slots[_GAP + j] > 0.0:
            play, rotor = slots[r.PLAY + j], slots[r.ROTOR + j]
            inertia = slots[_ROTOR_INERTIA + j]
            play, rotor, value = backlash(play, rotor, velocity[j], value, slots[_GAP + j], inertia, step_s)
            slots[r.PLAY + j], slots[r.ROTOR + j] = play, rotor
        torque[j] = value


@numba.njit
def friction_bound_nm(slots: np.ndarray, j: int, velocity_rad_s: float, torque_nm: float, external_nm: float) -> float:
    """The bound of joint j's friction constraint in this step."""
    speed_rad_s, exponent = slots[_STRIBECK_SPEED + j], slots[_STRIBECK_EXPONENT + j]
    bound = slots[_COULOMB + j] + stribeck_bound_nm(slots[_STRIBECK + j], speed_rad_s, exponent, velocity_rad_s)
    bound += load_bound_nm(slots[_LOAD + j], torque_nm, slots[_OUTER_LOAD + j], external_nm) + stuck_bound_nm(slots[_STUCK + j])
    return max(0.0, bound + directional_bound_nm(slots[_DIRECTION + j], velocity_rad_s))


@numba.njit
def push(slots: np.ndarray, axis: int) -> float:
    """Force on the cube along a world axis, N."""
    if slots[_PUSH] == 0.0:
        return 0.0
    block = math.floor(slots[r.CLOCK] * slots[r.STEP_S] / slots[_PUSH_TIME] + 1e-9)
    chance = uniform(slots[r.SEED], block, r.CHANNEL_PUSH_CHANCE)
    return push_force_n(slots[_PUSH], slots[_PUSH_CHANCE], chance, gaussian(slots[r.SEED], block, r.CHANNEL_PUSH + axis))


@numba.njit
def set_bounds(slots: np.ndarray, velocity: np.ndarray, bias: np.ndarray, report: np.ndarray, bounds: np.ndarray) -> None:
    """Set the bounds of the joints' friction constraints for this step; shapes (9,), N m.

    Args:
        slots: the simulation's record.
        velocity: true joint velocities, rad/s.
        bias: torques that gravity and motion ask of the joints, N m.
        report: what :func:`step_with_effects` reported in this step.
        bounds: set.
    """
    for j in range(9):
        bounds[j] = friction_bound_nm(slots, j, velocity[j], report[r.EFFECTIVE_TORQUE + j], bias[j])


@numba.njit
def step_with_effects(
    slots: np.ndarray, torque: np.ndarray, position: np.ndarray, velocity: np.ndarray, report: np.ndarray, force: np.ndarray
) -> None:
    """One step of one simulation.

    Args:
        slots: its record.
        torque: desired torque in, applied torque out (what the driver sent), shape (9,), N m.
        position: true joint positions, shape (9,), rad.
        velocity: true joint velocities, shape (9,), rad/s.
        report: filled with what is measured and what reached the joints, shape (36,).
        force: generalised forces to add, filled, shape (12,): nine joints in N m, then the cube along x, y, z in N.
    """
    for j in range(9):
        speed = filtered_velocity_rad_s(slots, j, velocity[j])
        report[r.MEASURED_POSITION + j] = measured_position_rad(slots, j, position[j])
        report[r.MEASURED_VELOCITY + j] = measured_velocity_rad_s(slots, j, speed)
        slots[r.FILTERED_VELOCITY + j] = speed
    if slots[r.SAFETY_ON] == 1.0:
        hold_late_command(slots, torque)
        protect(slots, torque, report[r.MEASURED_POSITION :], report[r.MEASURED_VELOCITY :])
    effective = report[r.EFFECTIVE_TORQUE :]
    delay(slots, torque, effective)
    add_noise(slots, effective)
    limit(slots, effective)
    for j in range(9):
        report[r.MEASURED_TORQUE + j] = measured_torque_nm(slots, j, effective[j])
    drive(slots, effective, position, velocity)
    for j in range(9):
        force[j] = effective[j] - torque[j]
    for axis in range(3):
        force[9 + axis] = push(slots, axis)
    slots[r.CLOCK] += 1.0
