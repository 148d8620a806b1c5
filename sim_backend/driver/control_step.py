"""What happens in one step between a desired torque and the joints, compiled: measure, hold, protect, delay, drive, rub, push.

All functions work on the slots of one simulation (``effects/record.py``). With every effect absent the applied torque is
that of the safety pipeline, bit for bit, and nothing else acts.
"""

import math

import numba

from sim_backend.driver.safety import joint_applied_torque_nm
from sim_backend.effects import record as r
from sim_backend.effects.actuation import (
    backlash,
    cogging_torque_nm,
    correlated_noise,
    delayed_torque_nm,
    derated_torque_nm,
    is_due,
    sagging_factor,
    saturated_torque_nm,
    scaled_gain,
    scaled_torque_nm,
    temperature_rise_k,
)
from sim_backend.effects.contact import push_force_n
from sim_backend.effects.friction import directional_bound_nm, load_bound_nm, stribeck_bound_nm, stuck_bound_nm
from sim_backend.effects.noise import gaussian, uniform
from sim_backend.effects.record import SLOTS
from sim_backend.effects.sensing import commanded_torque_nm, filtered, noisy, offset_position_rad, quantised
from sim_backend.trifinger import constants as c

_LOWER, _UPPER = tuple(c.SOFT_LIMIT_LOWER_RAD), tuple(c.SOFT_LIMIT_UPPER_RAD)
_KP, _KD = tuple(c.POSITION_GAIN_NM_RAD), tuple(c.VELOCITY_GAIN_NM_S_RAD)
_DAMPING, _LIMIT = tuple(c.SAFETY_DAMPING_NM_S_RAD), c.MAX_TORQUE_NM

_OFFSET, _JUMP = SLOTS["encoder_offset.offset_rad"], SLOTS["encoder_jump.offset_rad"]
_QUANTUM, _FILTER = SLOTS["encoder_quantisation.step_rad"], SLOTS["velocity_filter.time_constant_s"]
_POSITION_NOISE, _VELOCITY_NOISE = SLOTS["joint_noise.position_rad"], SLOTS["joint_noise.velocity_rad_s"]
_TORQUE_NOISE = SLOTS["joint_noise.torque_nm"]
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
_COULOMB, _LOAD = SLOTS[r.COULOMB], SLOTS["load_friction.coefficient"]
_STRIBECK, _STRIBECK_SPEED = SLOTS["stribeck_friction.extra_nm"], SLOTS["stribeck_friction.speed_rad_s"]
_DIRECTION, _STUCK = SLOTS["directional_friction.difference_nm"], SLOTS["stuck_joint.holding_torque_nm"]
_PUSH, _PUSH_CHANCE = SLOTS["cube_pushes.force_n"], SLOTS["cube_pushes.probability"]
_PUSH_TIME = SLOTS["cube_pushes.duration_s"]


@numba.njit
def measured_position_rad(slots, j, position_rad):
    """What the encoder of joint j reports now."""
    seed, clock = slots[r.SEED], slots[r.CLOCK]
    value = offset_position_rad(position_rad + slots[r.PLAY + j], slots[_OFFSET + j])
    value = offset_position_rad(value, slots[_JUMP + j])
    value = offset_position_rad(value, slots[r.POSITION_EPISODE + j])
    if slots[_POSITION_NOISE + j] != 0.0:
        value = noisy(value, slots[_POSITION_NOISE + j], gaussian(seed, clock, r.CHANNEL_POSITION + j))
    return quantised(value, slots[_QUANTUM + j])


@numba.njit
def filtered_velocity_rad_s(slots, j, velocity_rad_s):
    """The speed of joint j after the board's filter; its state is that of the step before."""
    turning = slots[r.ROTOR + j] if slots[_GAP + j] > 0.0 else velocity_rad_s
    return filtered(slots[r.FILTERED_VELOCITY + j], turning, slots[r.STEP_S], slots[_FILTER + j])


@numba.njit
def measured_velocity_rad_s(slots, j, filtered_rad_s):
    """What the board of joint j reports now as its speed."""
    seed, clock = slots[r.SEED], slots[r.CLOCK]
    value = filtered_rad_s + slots[r.VELOCITY_EPISODE + j]
    if slots[_VELOCITY_NOISE + j] != 0.0:
        value = noisy(value, slots[_VELOCITY_NOISE + j], gaussian(seed, clock, r.CHANNEL_VELOCITY + j))
    return value


@numba.njit
def measure_joints(records, position_rad, velocity_rad_s, measured_position, measured_velocity):
    """What n robots would report now, without moving their clocks; shapes (n, slots) and (n, 9), results in the last two."""
    for i in range(len(records)):
        for j in range(9):
            measured_position[i, j] = measured_position_rad(records[i], j, position_rad[i, j])
            speed = filtered_velocity_rad_s(records[i], j, velocity_rad_s[i, j])
            measured_velocity[i, j] = measured_velocity_rad_s(records[i], j, speed)


@numba.njit
def hold_late_command(slots, torque):
    """Timing jitter: let the previous command act until the new one has come; shape (9,)."""
    if slots[_JITTER] == 0.0:
        for j in range(9):
            slots[r.HELD_TORQUE + j] = torque[j]
            slots[r.HELD_TARGET + j] = slots[r.POSITION_TARGET + j]
        return
    now_s, is_new = slots[r.CLOCK] * slots[r.STEP_S], False
    for j in range(9):
        target, awaited = slots[r.POSITION_TARGET + j], slots[r.AWAITED_TARGET + j]
        if torque[j] != slots[r.AWAITED_TORQUE + j] or (target != awaited and not (math.isnan(target) and math.isnan(awaited))):
            is_new = True
    if is_new:
        late = abs(gaussian(slots[r.SEED], slots[r.CLOCK], r.CHANNEL_LATENESS))
        slots[r.DUE_S] = now_s + slots[_JITTER] * late
        for j in range(9):
            slots[r.AWAITED_TORQUE + j] = torque[j]
            slots[r.AWAITED_TARGET + j] = slots[r.POSITION_TARGET + j]
    if is_due(now_s, slots[r.DUE_S]):
        for j in range(9):
            slots[r.HELD_TORQUE + j] = slots[r.AWAITED_TORQUE + j]
            slots[r.HELD_TARGET + j] = slots[r.AWAITED_TARGET + j]


@numba.njit
def protect_nominal(slots, torque, position, velocity):
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
def protect(slots, torque, position, velocity):
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
def delay(slots, torque, arrived):
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
        whole = math.floor(steps + 1e-9)
        fraction = steps - whole if steps - whole > 1e-6 else 0.0
        newer, older = (clock - whole) % length, (clock - whole - 1) % length
        arrived[j] = delayed_torque_nm(slots[r.RING + 9 * newer + j], slots[r.RING + 9 * older + j], fraction)


@numba.njit
def drive(slots, torque, position, velocity):
    """From the torque that arrived at the motors to the torque at the joints, in place; true states, shapes (9,)."""
    seed, clock, step_s = slots[r.SEED], slots[r.CLOCK], slots[r.STEP_S]
    total = 0.0
    for j in range(9):
        if slots[_WHITE + j] != 0.0 or slots[_RELATIVE + j] != 0.0:
            block = math.floor(clock * step_s / slots[_HOLD] + 1e-9)
            torque[j] += slots[_WHITE + j] * gaussian(seed, block, r.CHANNEL_WHITE + j)
            if slots[_RELATIVE + j] != 0.0:
                torque[j] *= 1.0 + slots[_RELATIVE + j] * gaussian(seed, block, r.CHANNEL_RELATIVE + j)
        if slots[_SLOW + j] != 0.0:
            fresh = gaussian(seed, clock, r.CHANNEL_CORRELATED + j)
            kept = correlated_noise(slots[r.CORRELATED + j], fresh, step_s, slots[_SLOW_TIME]) if clock > 0.0 else fresh
            slots[r.CORRELATED + j] = kept
            torque[j] += slots[_SLOW + j] * kept
        total += abs(torque[j])
    left = sagging_factor(slots[_SAG], total)
    for j in range(9):
        value = saturated_torque_nm(torque[j], slots[_SATURATION + j] * left)
        warm = r.TEMPERATURE + j
        slots[warm] = temperature_rise_k(slots[warm], value, slots[_RISE + j], slots[_WARM_TIME + j], step_s)
        value = derated_torque_nm(scaled_torque_nm(value, slots[_CONSTANT + j]), slots[warm], slots[_LOSS + j])
        value += cogging_torque_nm(slots[_COGGING + j], slots[_CYCLES + j], slots[_PHASE + j], position[j])
        if slots[_GAP + j] > 0.0:
            play, rotor = slots[r.PLAY + j], slots[r.ROTOR + j]
            inertia = slots[_ROTOR_INERTIA + j]
            play, rotor, value = backlash(play, rotor, velocity[j], value, slots[_GAP + j], inertia, step_s)
            slots[r.PLAY + j], slots[r.ROTOR + j] = play, rotor
        torque[j] = value


@numba.njit
def friction_bound_nm(slots, j, velocity_rad_s, torque_nm):
    """The bound of joint j's friction constraint in this step."""
    bound = slots[_COULOMB + j] + stribeck_bound_nm(slots[_STRIBECK + j], slots[_STRIBECK_SPEED + j], velocity_rad_s)
    bound += load_bound_nm(slots[_LOAD + j], torque_nm) + stuck_bound_nm(slots[_STUCK + j])
    return max(0.0, bound + directional_bound_nm(slots[_DIRECTION + j], velocity_rad_s))


@numba.njit
def push(slots, axis):
    """Force on the cube along a world axis, N."""
    if slots[_PUSH] == 0.0:
        return 0.0
    block = math.floor(slots[r.CLOCK] * slots[r.STEP_S] / slots[_PUSH_TIME] + 1e-9)
    chance = uniform(slots[r.SEED], block, r.CHANNEL_PUSH_CHANCE)
    return push_force_n(slots[_PUSH], slots[_PUSH_CHANCE], chance, gaussian(slots[r.SEED], block, r.CHANNEL_PUSH + axis))


@numba.njit
def measured_torque_nm(slots, j, sent_nm):
    """What the board of joint j reports as its torque: the current that it regulates, not what reaches the joint."""
    if slots[_TORQUE_NOISE + j] == 0.0:
        return sent_nm
    return noisy(sent_nm, slots[_TORQUE_NOISE + j], gaussian(slots[r.SEED], slots[r.CLOCK], r.CHANNEL_TORQUE + j))


@numba.njit
def set_bounds(slots, velocity, report, in_order, by_island, rows):
    """Bounds of the joints' friction constraints for this step.

    Args:
        slots: the simulation's record.
        velocity: true joint velocities, shape (9,), rad/s.
        report: what :func:`step_with_effects` reported in this step.
        in_order: bounds in the order of the joints, set, shape (9,), N m.
        by_island: the solver's copy, sorted by islands, set.
        rows: where each joint's bound is in the copy, shape (9,).
    """
    for j in range(9):
        in_order[j] = friction_bound_nm(slots, j, velocity[j], report[r.EFFECTIVE_TORQUE + j])
        by_island[rows[j]] = in_order[j]


@numba.njit
def step_with_effects(slots, torque, position, velocity, report, force):
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
    hold_late_command(slots, torque)
    protect(slots, torque, report[r.MEASURED_POSITION :], report[r.MEASURED_VELOCITY :])
    effective = report[r.EFFECTIVE_TORQUE :]
    delay(slots, torque, effective)
    drive(slots, effective, position, velocity)
    for j in range(9):
        report[r.MEASURED_TORQUE + j] = measured_torque_nm(slots, j, torque[j])
        force[j] = effective[j] - torque[j]
    for axis in range(3):
        force[9 + axis] = push(slots, axis)
    slots[r.CLOCK] += 1.0
