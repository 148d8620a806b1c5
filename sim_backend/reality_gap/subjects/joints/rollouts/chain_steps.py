"""Steps of trees of links, compiled: what drives the joints, motors, and the impulses of dry friction."""

import functools
from collections.abc import Callable

import numba
import numpy as np
from numba import types

from sim_backend.driver.compilation import compiled_once
from sim_backend.reality_gap.subjects.joints.laws import motor_law
from sim_backend.reality_gap.subjects.joints.laws.motor_law import sent_to_joint, values_of
from sim_backend.reality_gap.subjects.joints.rollouts import link_dynamics
from sim_backend.reality_gap.subjects.joints.rollouts.link_dynamics import compiled, loads, masses, place, screws

_SWEEPS, _SETTLED = 50, 1e-7
"""Of the impulses of friction at most, and the change, as a share of the largest bound, at which they have settled."""
_BENT_RAD_S = 0.005
"""Speed at which a window's bearings begin half bent: a joint that moves has bent them, one that rests may have."""
_DIVERGED = 1e4
"""Of a velocity, rad/s."""
_ARMATURE, _DAMPING, _STIFFNESS, _REST, _OFFSET, _LATE, _OF_GAIN, _OF_OWN, _GAP, _ROTOR, _GIVE, _CREEP = range(12)
_AHEAD, _SPEED, _SIDE, _RUBS = range(4)
"""Of a rotor with play: by how much it is before its link, how fast it turns on its way across, the side on which it lies (1 or
-1; 0 on its way), and what friction it has there.
"""
_UNKNOWN_SIDE = 2.0
"""At first: the first step shows where a rotor presses."""
_TARGET, _GAIN, _BRAKE, _LIMIT, _BACK_EMF, _DESIRED, _ON_BOARD = range(7)


@compiled
def _inverted(matrix: np.ndarray, room: np.ndarray, out: np.ndarray) -> None:
    """The inverse of a positive definite matrix, by Cholesky; all of shape (k, k), reciprocals on the diagonal of ``room``."""
    k = len(matrix)
    for i in range(k):
        for j in range(i + 1):
            total = matrix[i, j]
            for a in range(j):
                total -= room[i, a] * room[j, a]
            room[i, j] = 1.0 / np.sqrt(total) if i == j else total * room[j, j]
    for c in range(k):
        for i in range(c, k):
            total = 1.0 if i == c else 0.0
            for a in range(c, i):
                total -= room[i, a] * out[a, c]
            out[i, c] = total * room[i, i]
        for i in range(k - 1, c - 1, -1):
            total = out[i, c]
            for a in range(i + 1, k):
                total -= room[a, i] * out[a, c]
            out[i, c] = out[c, i] = total * room[i, i]


@compiled
def _held(bend: float, give: float, creep: float, step_s: float, velocity: float, stops: float) -> float:
    """Share of its friction that a bearing holds after a step, -1 to 1, which gives and creeps until it slips at 1.

    A spring and a damper in series: the share grows by what the joint moves less what it creeps, over what it gives. It is solved
    for the end of the step, at which the friction has changed ``velocity`` by that share of ``stops``.
    """
    return min(max((give * bend + step_s * velocity) / (give + step_s * (creep + stops)), -1.0), 1.0)


@compiled
def _rub(
    inverse: np.ndarray,
    bound: np.ndarray,
    joints: np.ndarray,
    m: int,
    bend: np.ndarray,
    step_s: float,
    velocity: np.ndarray,
    impulse: np.ndarray,
) -> None:
    """Stop what dry friction can stop: impulses within their bounds that leave joints at rest or oppose their motion.

    Of bearings that give or creep they are the share of the bounds that :func:`_held` says. ``velocity`` is that after the step
    without friction and is moved on; ``impulse`` and ``bend`` are those of the step before, and ``bend`` stays so.
    """
    k, largest = len(bound), 0.0
    for j in range(k):
        most = bound[j] * step_s
        largest = max(largest, most)
        impulse[j] = min(max(impulse[j], -most), most)
        if impulse[j] != 0.0:
            for i in range(k):
                velocity[i] += inverse[i, j] * impulse[j]
    if largest == 0.0:
        return
    for _ in range(_SWEEPS):
        change = 0.0
        for j in range(k):
            most = bound[j] * step_s
            if most == 0.0:
                continue
            give, creep, own = joints[_GIVE, m, j], joints[_CREEP, m, j], inverse[j, j]
            if give + creep > 0.0:
                wanted = -most * _held(bend[j], give, creep, step_s, velocity[j] - own * impulse[j], own * most)
            else:
                wanted = min(max(impulse[j] - velocity[j] / own, -most), most)
            by = wanted - impulse[j]
            if by != 0.0:
                impulse[j] = wanted
                change = max(change, abs(by))
                for i in range(k):
                    velocity[i] += inverse[i, j] * by
        if change <= _SETTLED * largest:
            return


@compiled
def _moved_on(
    inverse: np.ndarray,
    rest: np.ndarray,
    bound: np.ndarray,
    joints: np.ndarray,
    m: int,
    rotors: np.ndarray,
    bend: np.ndarray,
    step_s: float,
    position: np.ndarray,
    velocity: np.ndarray,
    gained: np.ndarray,
    impulse: np.ndarray,
) -> bool:
    """Move joints on by impulses that are left, and by friction; ``gained`` is by how much. Whether they do not diverge."""
    k, fastest = len(velocity), 0.0
    for i in range(k):
        gained[i] = velocity[i]
        for j in range(k):
            velocity[i] += inverse[i, j] * rest[j]
    _rub(inverse, bound, joints, m, bend, step_s, velocity, impulse)
    for j in range(k):
        give, creep = joints[_GIVE, m, j], joints[_CREEP, m, j]
        if give + creep > 0.0:
            speed = rotors[_SPEED, j] if rotors[_SIDE, j] == 0.0 else velocity[j]
            bend[j] = _held(bend[j], give, creep, step_s, speed, 0.0)
        position[j] += step_s * velocity[j]
        gained[j] = velocity[j] - gained[j]
        fastest = max(fastest, abs(velocity[j]))
    return fastest < _DIVERGED


@compiled
def _until(at: float, sums: np.ndarray, held: np.ndarray, window: int, joint: int) -> float:
    """Integral of what has arrived of a recorded torque, in samples; before and after it the first and the last one go on."""
    sample = int(min(max(np.floor(at), 0.0), held.shape[1] - 1.0))
    return sums[window, sample, joint] + (at - sample) * held[window, sample, joint]


@compiled
def _arriving(feedback: np.ndarray, what: int, w: int, at: float, lasts: float, joint: int) -> float:
    """Mean over a step of a target or desired torque that is held from sample to sample; the step begins ``at``, in samples.

    Before the first sample and after the last one these go on.
    """
    last = feedback.shape[2] - 1.0
    first, second = min(max(np.floor(at + 1e-9), 0.0), last), min(max(np.floor(at + lasts - 1e-9), 0.0), last)
    newest = feedback[what, w, int(second), joint]
    if first == second:
        return newest
    share = (at + lasts - second) / lasts
    return share * newest + (1.0 - share) * feedback[what, w, int(first), joint]


@compiled
def _made(
    feedback: np.ndarray,
    w: int,
    sample: int,
    lead: int,
    begin_s: float,
    step_s: float,
    sample_s: float,
    joint: int,
    joints: np.ndarray,
    m: int,
    rotors: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    gained: np.ndarray,
) -> float:
    """Torque that a joint's controller makes of what is reported; none where its law is not known.

    Of its gain, and of the voltage that its motor makes itself, a model may have a share. Targets are those that have come in the
    step that begins ``begin_s`` after its window, ``lead`` samples after the first one.
    """
    row = lead + sample
    at = lead + (begin_s - (joints[_LATE, m, joint] if feedback[_ON_BOARD, w, row, joint] > 0.5 else 0.0)) / sample_s
    reported = position[joint] + rotors[_AHEAD, joint] + joints[_OFFSET, m, joint]
    speed = rotors[_SPEED, joint] if rotors[_SIDE, joint] == 0.0 else velocity[joint] + 0.5 * gained[joint]
    stiffness = joints[_OF_GAIN, m, joint] * feedback[_GAIN, w, row, joint]
    target = _arriving(feedback, _TARGET, w, at, step_s / sample_s, joint)
    asked = stiffness * (target - reported) - feedback[_BRAKE, w, row, joint] * speed
    asked += _arriving(feedback, _DESIRED, w, at, step_s / sample_s, joint)
    limit = feedback[_LIMIT, w, row, joint]
    made = min(max(asked, -limit), limit) - joints[_OF_OWN, m, joint] * feedback[_BACK_EMF, w, row, joint] * speed
    return 0.0 if np.isnan(made) else made


@compiled
def _delayed(line: np.ndarray, now: int, steps: float, joint: int) -> float:
    """What was made some steps ago, of a line that goes round; between two of them by straight line."""
    back = int(np.floor(steps + 1e-9))
    newer, older = line[max(0, now - back) % len(line), joint], line[max(0, now - back - 1) % len(line), joint]
    return newer + (steps - back) * (older - newer)


@compiled
def _arrives(
    feedback: np.ndarray,
    w: int,
    lead: int,
    now: int,
    step_s: float,
    sample_s: float,
    held_steps: int,
    joint: int,
    joints: np.ndarray,
    m: int,
    rotors: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    gained: np.ndarray,
    made: np.ndarray,
    line: np.ndarray,
) -> float:
    """What arrives in a step of a joint's controller, which computes its torque now or holds it; ``made``, ``line`` remember."""
    sample = int(now * step_s / sample_s + 1e-9)
    on_board = feedback[_ON_BOARD, w, lead + sample, joint] > 0.5
    if held_steps == 0 or on_board or now % held_steps == 0:
        made[joint] = _made(
            feedback, w, sample, lead, now * step_s, step_s, sample_s, joint, joints, m, rotors, position, velocity, gained
        )
    line[now % len(line), joint] = made[joint]
    # a step moves velocities by what acts half a step before and after its begin
    steps = joints[_LATE, m, joint] / step_s + 0.5 * (held_steps > 0)
    return made[joint] if on_board else _delayed(line, now, max(0.0, steps), joint)


@compiled
def _follow_rotors(
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
        if joints[_GAP, m, j] <= 0.0:
            continue
        half, inertia, damping = 0.5 * joints[_GAP, m, j], joints[_ROTOR, m, j], joints[_DAMPING, m, j]
        if rotors[_SIDE, j] != 0.0:
            passes = torque[j] - damping * velocity[j] + (impulse[j] - inertia * gained[j]) / step_s
            if rotors[_SIDE, j] == _UNKNOWN_SIDE:
                rotors[_SIDE, j] = 1.0 if passes > 0.0 else -1.0
                rotors[_AHEAD, j] = rotors[_SIDE, j] * half
                position[j] -= rotors[_AHEAD, j]
            elif passes * rotors[_SIDE, j] < 0.0:
                rotors[_SIDE, j], rotors[_SPEED, j] = 0.0, velocity[j]
            continue
        speed = (rotors[_SPEED, j] + step_s * torque[j] / inertia) / (1.0 + step_s * damping / inertia)
        most = step_s * rotors[_RUBS, j] / inertia
        rotors[_SPEED, j] = speed - min(max(speed, -most), most)
        rotors[_AHEAD, j] += step_s * (rotors[_SPEED, j] - velocity[j])
        if abs(rotors[_AHEAD, j]) < half:
            continue
        rotors[_SIDE, j] = 1.0 if rotors[_AHEAD, j] > 0.0 else -1.0
        position[j] += rotors[_AHEAD, j] - rotors[_SIDE, j] * half
        rotors[_AHEAD, j] = rotors[_SIDE, j] * half
        push = (rotors[_SPEED, j] - velocity[j]) / (1.0 / inertia + inverse[j, j])
        for i in range(len(velocity)):
            velocity[i] += inverse[i, j] * push


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
        position[j], velocity[j] = begins[n, 0, j] - joints[_OFFSET, m, j], begins[n, 1, j]
        gained[j], impulse[j], bend[j] = 0.0, 0.0, velocity[j] / (abs(velocity[j]) + _BENT_RAD_S)
        memory[j, 0], memory[j, 1], memory[j, 2] = begins[n, 2, j], velocity[j], 0.0
        rotors[_AHEAD, j], rotors[_SIDE, j] = 0.0, _UNKNOWN_SIDE


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
    late = int(np.ceil(max(0.0, joints[_LATE].max()) / step_s + 1e-9)) + 3
    line, made, before, memory = np.zeros((late, k)), np.zeros(k), np.empty(k), np.empty((k, 3))
    # ``gained`` by velocities in the last step: they are those of half a step ago
    q, v, gained, rotors = np.empty(k), np.empty(k), np.empty(k), np.zeros((4, k))
    bend = np.empty(k)
    for n in range(len(window)):
        w, m = window[n], which[n]
        inertia, of_motors = inertias[m], motors[m]
        _begin(begins, n, joints, m, gravity, q, v, gained, impulse, memory, rotors, bend, faster)
        for j in range(k):
            before[j] = _until(-(joints[_LATE, m, j] + 0.5 * step_s) / sample_s, sums, sent, w, j)
        now, is_fine = 0, True
        for sample in range(samples):
            for _ in range(substeps):
                total = 0.0
                for j in range(k):
                    if is_known[j]:
                        arrived[j] = _arrives(
                            feedback, w, lead, now, step_s, sample_s, held_steps, j, joints, m, rotors, q, v, gained, made, line
                        )
                    else:
                        until = _until(((now + 1) * step_s - joints[_LATE, m, j] - 0.5 * step_s) / sample_s, sums, sent, w, j)
                        arrived[j] = (until - before[j]) * (sample_s / step_s)
                        before[j] = until
                    total += abs(arrived[j])
                    away[j] = q[j] - first[j]
                place(away, axis, anchor, slides, turn, move)
                loads(v, parent, screw, turn, move, inertia, moves, faster, forces, load)
                masses(parent, screw, turn, move, inertia, whole, mass)
                for j in range(k):
                    is_free, known = rotors[_SIDE, j] == 0.0, values_of(of_motors, j)
                    turned, speed = q[j] + rotors[_AHEAD, j], rotors[_SPEED, j] if is_free else v[j]
                    _, value[j], bound[j], memory[j, 0], memory[j, 1], memory[j, 2] = sent_to_joint(
                        arrived[j], total, turned, speed, load[j], step_s, known, memory[j, 0], memory[j, 1], memory[j, 2]
                    )
                    rest[j] = step_s * (joints[_STIFFNESS, m, j] * (joints[_REST, m, j] - q[j]) - load[j])
                    if is_free:  # what turns the rotor and what holds its bearing does not reach the link
                        rotors[_RUBS, j], bound[j] = bound[j], 0.0
                    else:
                        rest[j] += step_s * (value[j] - joints[_DAMPING, m, j] * v[j])
                        mass[j, j] += joints[_ARMATURE, m, j] + step_s * joints[_DAMPING, m, j]
                _inverted(mass, lower, inverse)
                is_fine = _moved_on(inverse, rest, bound, joints, m, rotors, bend, step_s, q, v, gained, impulse)
                _follow_rotors(joints, m, value, step_s, inverse, rotors, q, v, gained, impulse)
                if not is_fine:
                    break
                now += 1
            if not is_fine:
                break
            for j in range(k):
                found[n, sample, j] = q[j] + rotors[_AHEAD, j] + joints[_OFFSET, m, j]
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
        motor_law.__file__,
        link_dynamics.__file__,
    )
