"""A step of rotors that have play before their links, compiled."""

import numpy as np

from sim_backend.reality_gap.subjects.joints.rollouts.chain_slots import (
    AHEAD,
    DAMPING,
    GAP,
    ROTOR,
    RUBS,
    SIDE,
    SPEED,
    UNKNOWN_SIDE,
)
from sim_backend.reality_gap.subjects.joints.rollouts.link_dynamics import compiled


@compiled
def follow_rotors(
    joints: np.ndarray,
    m: int,
    torque: np.ndarray,
    step_s: float,
    inverse: np.ndarray,
    rotors: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    gained: np.ndarray,
    impulse: np.ndarray,
) -> None:
    """After a step: whether rotors with play leave the side on which they lie, and where those are that are on their way across.

    Rotor and link are one while the rotor presses. It leaves where it would have to pull: then it turns by its motor's ``torque``
    and friction alone, and shares its momentum with the links where it arrives.
    """
    for j in range(len(velocity)):
        if joints[GAP, m, j] <= 0.0:
            continue
        half, inertia, damping = 0.5 * joints[GAP, m, j], joints[ROTOR, m, j], joints[DAMPING, m, j]
        if rotors[SIDE, j] != 0.0:
            passes = torque[j] - damping * velocity[j] + (impulse[j] - inertia * gained[j]) / step_s
            if rotors[SIDE, j] == UNKNOWN_SIDE:
                rotors[SIDE, j] = 1.0 if passes > 0.0 else -1.0
                rotors[AHEAD, j] = rotors[SIDE, j] * half
                position[j] -= rotors[AHEAD, j]
            elif passes * rotors[SIDE, j] < 0.0:
                rotors[SIDE, j], rotors[SPEED, j] = 0.0, velocity[j]
            continue
        speed = (rotors[SPEED, j] + step_s * torque[j] / inertia) / (1.0 + step_s * damping / inertia)
        most = step_s * rotors[RUBS, j] / inertia
        rotors[SPEED, j] = speed - min(max(speed, -most), most)
        rotors[AHEAD, j] += step_s * (rotors[SPEED, j] - velocity[j])
        if abs(rotors[AHEAD, j]) < half:
            continue
        rotors[SIDE, j] = 1.0 if rotors[AHEAD, j] > 0.0 else -1.0
        position[j] += rotors[AHEAD, j] - rotors[SIDE, j] * half
        rotors[AHEAD, j] = rotors[SIDE, j] * half
        push = (rotors[SPEED, j] - velocity[j]) / (1.0 / inertia + inverse[j, j])
        for i in range(len(velocity)):
            velocity[i] += inverse[i, j] * push
