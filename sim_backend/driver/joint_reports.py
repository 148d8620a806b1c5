"""What encoders and motor boards report of the joints, compiled; on the slots of one simulation (``effects/record.py``)."""

import numba
import numpy as np

from sim_backend.effects import record as r
from sim_backend.effects.noise import gaussian
from sim_backend.effects.record import SLOTS
from sim_backend.effects.sensing import filtered, noisy, offset_position_rad, quantised

_OFFSET, _JUMP = SLOTS["encoder_offset.offset_rad"], SLOTS["encoder_jump.offset_rad"]
_QUANTUM, _FILTER = SLOTS["encoder_quantisation.step_rad"], SLOTS["velocity_filter.time_constant_s"]
_POSITION_NOISE, _VELOCITY_NOISE = SLOTS["joint_noise.position_rad"], SLOTS["joint_noise.velocity_rad_s"]
_TORQUE_NOISE = SLOTS["joint_noise.torque_nm"]
_GAP = SLOTS["backlash.gap_rad"]


@numba.njit
def measured_position_rad(slots: np.ndarray, j: int, position_rad: float) -> float:
    """What the encoder of joint j reports now."""
    seed, clock = slots[r.SEED], slots[r.CLOCK]
    value = offset_position_rad(position_rad + slots[r.PLAY + j], slots[_OFFSET + j])
    value = offset_position_rad(value, slots[_JUMP + j])
    value = offset_position_rad(value, slots[r.POSITION_EPISODE + j])
    if slots[_POSITION_NOISE + j] != 0.0:
        value = noisy(value, slots[_POSITION_NOISE + j], gaussian(seed, clock, r.CHANNEL_POSITION + j))
    return quantised(value, slots[_QUANTUM + j])


@numba.njit
def filtered_velocity_rad_s(slots: np.ndarray, j: int, velocity_rad_s: float) -> float:
    """The speed of joint j after the board's filter; its state is that of the step before."""
    is_free = abs(slots[r.PLAY + j]) < 0.5 * slots[_GAP + j]  # otherwise the rotor presses against its side of the play
    turning = slots[r.ROTOR + j] if is_free else velocity_rad_s
    return filtered(slots[r.FILTERED_VELOCITY + j], turning, slots[r.STEP_S], slots[_FILTER + j])


@numba.njit
def measured_velocity_rad_s(slots: np.ndarray, j: int, filtered_rad_s: float) -> float:
    """What the board of joint j reports now as its speed."""
    seed, clock = slots[r.SEED], slots[r.CLOCK]
    value = filtered_rad_s + slots[r.VELOCITY_EPISODE + j]
    if slots[_VELOCITY_NOISE + j] != 0.0:
        value = noisy(value, slots[_VELOCITY_NOISE + j], gaussian(seed, clock, r.CHANNEL_VELOCITY + j))
    return value


@numba.njit
def measure_joints(
    records: np.ndarray,
    position_rad: np.ndarray,
    velocity_rad_s: np.ndarray,
    measured_position: np.ndarray,
    measured_velocity: np.ndarray,
) -> None:
    """What n robots would report now, without moving their clocks; shapes (n, slots) and (n, 9), results in the last two."""
    for i in range(len(records)):
        for j in range(9):
            measured_position[i, j] = measured_position_rad(records[i], j, position_rad[i, j])
            speed = filtered_velocity_rad_s(records[i], j, velocity_rad_s[i, j])
            measured_velocity[i, j] = measured_velocity_rad_s(records[i], j, speed)


@numba.njit
def measured_torque_nm(slots: np.ndarray, j: int, current_nm: float) -> float:
    """What the board of joint j reports as its torque: that of its current, which is not what reaches the joint."""
    if slots[_TORQUE_NOISE + j] == 0.0:
        return current_nm
    return noisy(current_nm, slots[_TORQUE_NOISE + j], gaussian(slots[r.SEED], slots[r.CLOCK], r.CHANNEL_TORQUE + j))
