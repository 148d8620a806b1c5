"""Simulations of trees of links, compiled: their loop over time, and what they begin with."""

import functools
from collections.abc import Callable

import numba
import numpy as np
from numba import types

from sim_backend.driver.compilation import compiled_once
from sim_backend.reality_gap.subjects.joints.laws import motor_law
from sim_backend.reality_gap.subjects.joints.laws.motor_law import along_one_nm, sent_to_joint, values_of
from sim_backend.reality_gap.subjects.joints.rollouts import (
    chain_slots,
    controller_steps,
    friction_steps,
    link_dynamics,
    rotor_steps,
)
from sim_backend.reality_gap.subjects.joints.rollouts.chain_slots import (
    AHEAD,
    ARMATURE,
    DAMPING,
    LATE,
    OFFSET,
    REST,
    RUBS,
    SIDE,
    SPEED,
    STIFFNESS,
    UNKNOWN_SIDE,
)
from sim_backend.reality_gap.subjects.joints.rollouts.controller_steps import arrives, sum_until
from sim_backend.reality_gap.subjects.joints.rollouts.friction_steps import inverted, moved_on
from sim_backend.reality_gap.subjects.joints.rollouts.link_dynamics import compiled, loads, masses, place, screws
from sim_backend.reality_gap.subjects.joints.rollouts.rotor_steps import follow_rotors

_BENT_RAD_S = 0.005
"""Speed at which a window's bearings begin half bent: a joint that moves has bent them, one that rests may have."""


@compiled
def _begin(
    begins: np.ndarray,
    n: int,
    joints: np.ndarray,
    m: int,
    gravity: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    gained: np.ndarray,
    impulse: np.ndarray,
    memory: np.ndarray,
    rotors: np.ndarray,
    bend: np.ndarray,
    faster: np.ndarray,
) -> None:
    """Fill in what a simulation begins with."""
    k = len(position)
    for a in range(3):
        faster[k, 3 + a] = -gravity[m, a]
    for j in range(k):
        position[j], velocity[j] = begins[n, 0, j] - joints[OFFSET, m, j], begins[n, 1, j]
        gained[j], impulse[j], bend[j] = 0.0, 0.0, velocity[j] / (abs(velocity[j]) + _BENT_RAD_S)
        memory[j, 0], memory[j, 1], memory[j, 2] = begins[n, 2, j], velocity[j], 0.0
        rotors[AHEAD, j], rotors[SIDE, j] = 0.0, UNKNOWN_SIDE


def _simulate(  # noqa: PLR0912  # one loop over time: compiled functions that it called would copy the state
    sent: np.ndarray,
    sums: np.ndarray,
    feedback: np.ndarray,
    is_known: np.ndarray,
    inertias: np.ndarray,
    gravity: np.ndarray,
    joints: np.ndarray,
    motors: np.ndarray,
    parent: np.ndarray,
    axis: np.ndarray,
    anchor: np.ndarray,
    slides: np.ndarray,
    first: np.ndarray,
    step_s: float,
    substeps: int,
    sample_s: float,
    held_steps: int,
    lead: int,
    begins: np.ndarray,
    window: np.ndarray,
    which: np.ndarray,
    found: np.ndarray,
) -> None:
    k, samples = found.shape[2], found.shape[1]
    screw = screws(axis, anchor, slides)
    turn, move, away = np.empty((k, 3, 3)), np.empty((k, 3)), np.empty(k)
    moves, faster, forces = np.zeros((k + 1, 6)), np.zeros((k + 1, 6)), np.empty((k, 6))
    whole, mass, lower, inverse = np.empty((k, 10)), np.zeros((k, k)), np.empty((k, k)), np.empty((k, k))
    load, arrived, value, bound, rest, impulse = np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.empty(k)
    late = int(np.ceil(max(0.0, joints[LATE].max()) / step_s + 1e-9)) + 3
    line, made, before, memory = np.zeros((late, k)), np.zeros(k), np.empty(k), np.empty((k, 3))
    # ``gained`` by velocities in the last step: they are those of half a step ago
    q, v, gained, rotors = np.empty(k), np.empty(k), np.empty(k), np.zeros((4, k))
    bend = np.empty(k)
    for n in range(len(window)):
        w, m = window[n], which[n]
        inertia, of_motors = inertias[m], motors[m]
        _begin(begins, n, joints, m, gravity, q, v, gained, impulse, memory, rotors, bend, faster)
        for j in range(k):
            before[j] = sum_until(-(joints[LATE, m, j] + 0.5 * step_s) / sample_s, sums, sent, w, j)
        now, is_fine = 0, True
        for sample in range(samples):
            for _ in range(substeps):
                total = 0.0
                for j in range(k):
                    if is_known[j]:
                        arrived[j] = arrives(
                            feedback, w, lead, now, step_s, sample_s, held_steps, j, joints, m, rotors, q, v, gained, made, line
                        )
                    else:
                        until = sum_until(((now + 1) * step_s - joints[LATE, m, j] - 0.5 * step_s) / sample_s, sums, sent, w, j)
                        arrived[j] = (until - before[j]) * (sample_s / step_s)
                        before[j] = until
                    total += abs(arrived[j])
                    away[j] = q[j] - first[j]
                place(away, axis, anchor, slides, turn, move)
                loads(v, parent, screw, turn, move, inertia, moves, faster, forces, load)
                masses(parent, screw, turn, move, inertia, whole, mass)
                for j in range(k):
                    is_free, known = rotors[SIDE, j] == 0.0, values_of(of_motors, j)
                    turned, speed = q[j] + rotors[AHEAD, j], rotors[SPEED, j] if is_free else v[j]
                    one_nm = along_one_nm(known, turned, speed)
                    _, value[j], bound[j], memory[j, 0], memory[j, 1], memory[j, 2] = sent_to_joint(
                        arrived[j], total, speed, load[j], step_s, known, one_nm, memory[j, 0], memory[j, 1], memory[j, 2]
                    )
                    rest[j] = step_s * (joints[STIFFNESS, m, j] * (joints[REST, m, j] - q[j]) - load[j])
                    if is_free:  # what turns the rotor and what holds its bearing does not reach the link
                        rotors[RUBS, j], bound[j] = bound[j], 0.0
                    else:
                        rest[j] += step_s * (value[j] - joints[DAMPING, m, j] * v[j])
                        mass[j, j] += joints[ARMATURE, m, j] + step_s * joints[DAMPING, m, j]
                inverted(mass, lower, inverse)
                is_fine = moved_on(inverse, rest, bound, joints, m, rotors, bend, step_s, q, v, gained, impulse)
                follow_rotors(joints, m, value, step_s, inverse, rotors, q, v, gained, impulse)
                if not is_fine:
                    break
                now += 1
            if not is_fine:
                break
            for j in range(k):
                found[n, sample, j] = q[j] + rotors[AHEAD, j] + joints[OFFSET, m, j]
        if not is_fine:
            found[n] = np.nan


@functools.cache
def simulate() -> Callable[..., None]:
    """Simulate n stretches, compiled, without the interpreter's lock; ``found`` is filled in, NaN where a simulation diverges.

    Its arguments, of w windows, m models and k joints in the order of their tree: torques that were recorded (w, s, k) and their
    sums (w, s + 1, k), a controller's law (6, w, s, k), which joints it drives (k,); inertias of the links (m, k, 10), gravity
    (m, 3), armature, damping, stiffness, rest, offset of the encoder, lateness of what is sent, share of the controller's gain,
    play and inertia of the rotor, how far bearings give and how fast they creep (12, m, k), the motor law's values (m, k, p);
    parents (k,), axes and anchors (k, 3), which joints slide, where joints are at first (k,); the step, steps to a sample, the
    time between samples, steps for which a controller holds its torque; begins (n, 3, k): places, speeds and warmth of the
    motors, windows and models (n,), and the positions after each sample (n, s, k).
    """
    f1, f2, f3, f4 = (types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1], types.float64[:, :, :, ::1])
    i1, b1 = types.int64[::1], types.boolean[::1]
    of_windows = (f3, f3, f4, b1)
    of_models = (f3, f2, f3, f3, i1, f2, f2, b1, f1)
    of_time = (types.float64, types.int64, types.float64, types.int64, types.int64)
    signature = types.void(*of_windows, *of_models, *of_time, f3, i1, i1, f3)
    return compiled_once(
        lambda cache: numba.njit(signature, cache=cache, nogil=True, error_model="numpy")(_simulate),
        *(room.__file__ for room in (motor_law, link_dynamics, chain_slots, controller_steps, friction_steps, rotor_steps)),
    )
