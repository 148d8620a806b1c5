"""Steps of a tree of links, compiled: kinematics, forces, inertias, motors and the impulses of dry friction.

Motions are (angular, linear) at the origin of a link's frame, forces (moment, force) there; an inertia is mass, mass times centre
(3) and the moments xx, yy, zz, xy, xz, yz about the origin. ``turn`` and ``move`` place a link's frame in that of its parent.
"""

import functools
from collections.abc import Callable

import numba
import numpy as np
from numba import types  # pyright: ignore[reportPrivateImportUsage]

from sim_backend.driver.compilation import compiled_once
from sim_backend.reality_gap.subjects.joints import motor_law
from sim_backend.reality_gap.subjects.joints.motor_law import sent_to_joint

_SWEEPS, _SETTLED = 50, 1e-7
"""Of the impulses of friction at most, and the change, as a share of the largest bound, at which they have settled."""
_DIVERGED = 1e4
"""Of a velocity, rad/s."""
_ARMATURE, _DAMPING, _STIFFNESS, _REST, _OFFSET, _LATE, _OF_GAIN = range(7)
_TARGET, _GAIN, _BRAKE, _LIMIT, _BACK_EMF, _DESIRED = range(6)


@numba.njit
def _add_cross(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@numba.njit
def _into_child(turn: np.ndarray, move: np.ndarray, motion: np.ndarray, out: np.ndarray) -> None:
    """A motion in the frame of a parent, in that of its child; shapes (6,)."""
    x = motion[3] + motion[1] * move[2] - motion[2] * move[1]
    y = motion[4] + motion[2] * move[0] - motion[0] * move[2]
    z = motion[5] + motion[0] * move[1] - motion[1] * move[0]
    for a in range(3):
        out[a] = turn[0, a] * motion[0] + turn[1, a] * motion[1] + turn[2, a] * motion[2]
        out[3 + a] = turn[0, a] * x + turn[1, a] * y + turn[2, a] * z


@numba.njit
def _add_into_parent(turn: np.ndarray, move: np.ndarray, force: np.ndarray, out: np.ndarray) -> None:
    """Add a force in the frame of a child to one in that of its parent; shapes (6,)."""
    x = turn[0, 0] * force[3] + turn[0, 1] * force[4] + turn[0, 2] * force[5]
    y = turn[1, 0] * force[3] + turn[1, 1] * force[4] + turn[1, 2] * force[5]
    z = turn[2, 0] * force[3] + turn[2, 1] * force[4] + turn[2, 2] * force[5]
    out[3] += x
    out[4] += y
    out[5] += z
    for a in range(3):
        out[a] += turn[a, 0] * force[0] + turn[a, 1] * force[1] + turn[a, 2] * force[2]
    out[0] += move[1] * z - move[2] * y
    out[1] += move[2] * x - move[0] * z
    out[2] += move[0] * y - move[1] * x


@numba.njit
def _times(inertia: np.ndarray, motion: np.ndarray, out: np.ndarray) -> None:
    """Force that an inertia needs for an acceleration, or momentum of a motion; out of shape (6,)."""
    m, cx, cy, cz = inertia[0], inertia[1], inertia[2], inertia[3]
    wx, wy, wz, vx, vy, vz = motion[0], motion[1], motion[2], motion[3], motion[4], motion[5]
    out[0] = inertia[4] * wx + inertia[7] * wy + inertia[8] * wz + cy * vz - cz * vy
    out[1] = inertia[7] * wx + inertia[5] * wy + inertia[9] * wz + cz * vx - cx * vz
    out[2] = inertia[8] * wx + inertia[9] * wy + inertia[6] * wz + cx * vy - cy * vx
    out[3] = m * vx + wy * cz - wz * cy
    out[4] = m * vy + wz * cx - wx * cz
    out[5] = m * vz + wx * cy - wy * cx


@numba.njit
def _add_inertia_to_parent(turn: np.ndarray, move: np.ndarray, own: np.ndarray, out: np.ndarray) -> None:
    """Add an inertia in the frame of a child to one in that of its parent; shapes (10,)."""
    m = own[0]
    x = turn[0, 0] * own[1] + turn[0, 1] * own[2] + turn[0, 2] * own[3]
    y = turn[1, 0] * own[1] + turn[1, 1] * own[2] + turn[1, 2] * own[3]
    z = turn[2, 0] * own[1] + turn[2, 1] * own[2] + turn[2, 2] * own[3]
    tx, ty, tz = move[0], move[1], move[2]
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(3):
        pa = own[4 + a]
        xx += turn[0, a] * turn[0, a] * pa
        yy += turn[1, a] * turn[1, a] * pa
        zz += turn[2, a] * turn[2, a] * pa
        xy += turn[0, a] * turn[1, a] * pa
        xz += turn[0, a] * turn[2, a] * pa
        yz += turn[1, a] * turn[2, a] * pa
    for a, b, p in ((0, 1, own[7]), (0, 2, own[8]), (1, 2, own[9])):
        xx += 2.0 * turn[0, a] * turn[0, b] * p
        yy += 2.0 * turn[1, a] * turn[1, b] * p
        zz += 2.0 * turn[2, a] * turn[2, b] * p
        xy += (turn[0, a] * turn[1, b] + turn[0, b] * turn[1, a]) * p
        xz += (turn[0, a] * turn[2, b] + turn[0, b] * turn[2, a]) * p
        yz += (turn[1, a] * turn[2, b] + turn[1, b] * turn[2, a]) * p
    square = m * (tx * tx + ty * ty + tz * tz) + 2.0 * (x * tx + y * ty + z * tz)
    out[0] += m
    out[1] += x + m * tx
    out[2] += y + m * ty
    out[3] += z + m * tz
    out[4] += xx + square - (2.0 * x * tx + m * tx * tx)
    out[5] += yy + square - (2.0 * y * ty + m * ty * ty)
    out[6] += zz + square - (2.0 * z * tz + m * tz * tz)
    out[7] += xy - (x * ty + y * tx + m * tx * ty)
    out[8] += xz - (x * tz + z * tx + m * tx * tz)
    out[9] += yz - (y * tz + z * ty + m * ty * tz)


@numba.njit
def _place(
    position: np.ndarray, axis: np.ndarray, anchor: np.ndarray, slides: np.ndarray, turn: np.ndarray, move: np.ndarray
) -> None:
    """Frames of k links in those of their parents, by how far joints are from where the model has them at first."""
    for i in range(len(position)):
        x, y, z, by = axis[i, 0], axis[i, 1], axis[i, 2], position[i]
        if slides[i]:
            turn[i] = np.eye(3)
            move[i, 0], move[i, 1], move[i, 2] = by * x, by * y, by * z
            continue
        s, c = np.sin(by), np.cos(by)
        d = 1.0 - c
        turn[i, 0, 0], turn[i, 0, 1], turn[i, 0, 2] = c + d * x * x, d * x * y - s * z, d * x * z + s * y
        turn[i, 1, 0], turn[i, 1, 1], turn[i, 1, 2] = d * x * y + s * z, c + d * y * y, d * y * z - s * x
        turn[i, 2, 0], turn[i, 2, 1], turn[i, 2, 2] = d * x * z - s * y, d * y * z + s * x, c + d * z * z
        for a in range(3):
            move[i, a] = anchor[i, a] - (
                turn[i, a, 0] * anchor[i, 0] + turn[i, a, 1] * anchor[i, 1] + turn[i, a, 2] * anchor[i, 2]
            )


@numba.njit
def _loads(
    velocity: np.ndarray,
    gravity: np.ndarray,
    parent: np.ndarray,
    screw: np.ndarray,
    turn: np.ndarray,
    move: np.ndarray,
    inertia: np.ndarray,
    room: np.ndarray,
    load: np.ndarray,
) -> None:
    """What gravity and motion ask of the joints, shape (k,), by Newton and Euler; ``room`` of shape (5, k, 6) is overwritten."""
    moves, faster, forces, base, held = room[0], room[1], room[2], room[3, 0], room[4, 0]
    k = len(velocity)
    for i in range(k):
        s, v = screw[i], velocity[i]
        if parent[i] < 0:
            moves[i] = 0.0
            base[:3] = 0.0
            for a in range(3):
                base[3 + a] = -gravity[a]
            _into_child(turn[i], move[i], base, faster[i])
        else:
            _into_child(turn[i], move[i], moves[parent[i]], moves[i])
            _into_child(turn[i], move[i], faster[parent[i]], faster[i])
        for a in range(6):
            moves[i, a] += s[a] * v
            held[a] = s[a] * v
        _add_cross(moves[i, :3], held[:3], faster[i, :3])
        _add_cross(moves[i, :3], held[3:], faster[i, 3:])
        _add_cross(moves[i, 3:], held[:3], faster[i, 3:])
        _times(inertia[i], moves[i], held)
        _times(inertia[i], faster[i], forces[i])
        _add_cross(moves[i, :3], held[:3], forces[i, :3])
        _add_cross(moves[i, 3:], held[3:], forces[i, :3])
        _add_cross(moves[i, :3], held[3:], forces[i, 3:])
    for i in range(k - 1, -1, -1):
        total = 0.0
        for a in range(6):
            total += screw[i, a] * forces[i, a]
        load[i] = total
        if parent[i] >= 0:
            _add_into_parent(turn[i], move[i], forces[i], forces[parent[i]])


@numba.njit
def _masses(
    parent: np.ndarray,
    screw: np.ndarray,
    turn: np.ndarray,
    move: np.ndarray,
    inertia: np.ndarray,
    whole: np.ndarray,
    room: np.ndarray,
    out: np.ndarray,
) -> None:
    """Inertia of the joints, shape (k, k), by composite bodies; ``whole`` (k, 10) and ``room`` (2, 6) are overwritten."""
    k = len(parent)
    whole[:] = inertia
    out[:] = 0.0
    for i in range(k - 1, -1, -1):
        if parent[i] >= 0:
            _add_inertia_to_parent(turn[i], move[i], whole[i], whole[parent[i]])
    for i in range(k):
        force, other = room[0], room[1]
        _times(whole[i], screw[i], force)
        j = i
        while True:
            total = 0.0
            for a in range(6):
                total += screw[j, a] * force[a]
            out[i, j] = out[j, i] = total
            if parent[j] < 0:
                break
            other[:] = 0.0
            _add_into_parent(turn[j], move[j], force, other)
            for a in range(6):
                force[a] = other[a]
            j = parent[j]


@numba.njit
def _inverted(matrix: np.ndarray, room: np.ndarray, out: np.ndarray) -> None:
    """The inverse of a positive definite matrix, by Cholesky; all of shape (k, k)."""
    k = len(matrix)
    for i in range(k):
        for j in range(i + 1):
            total = matrix[i, j]
            for a in range(j):
                total -= room[i, a] * room[j, a]
            room[i, j] = np.sqrt(total) if i == j else total / room[j, j]
    for c in range(k):
        for i in range(k):
            total = 1.0 if i == c else 0.0
            for a in range(i):
                total -= room[i, a] * out[a, c]
            out[i, c] = total / room[i, i]
        for i in range(k - 1, -1, -1):
            total = out[i, c]
            for a in range(i + 1, k):
                total -= room[a, i] * out[a, c]
            out[i, c] = total / room[i, i]


@numba.njit
def _rub(inverse: np.ndarray, bound: np.ndarray, step_s: float, velocity: np.ndarray, impulse: np.ndarray) -> None:
    """Stop what dry friction can stop: impulses within their bounds that leave joints at rest or oppose their motion.

    ``velocity`` is that after the step without friction and is moved on; ``impulse`` is that of the step before.
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
            wanted = min(max(impulse[j] - velocity[j] / inverse[j, j], -most), most)
            by = wanted - impulse[j]
            if by != 0.0:
                impulse[j] = wanted
                change = max(change, abs(by))
                for i in range(k):
                    velocity[i] += inverse[i, j] * by
        if change <= _SETTLED * largest:
            return


@numba.njit
def _until(at: float, sums: np.ndarray, held: np.ndarray, joint: int) -> float:
    """Integral of what has arrived of a recorded torque, in samples; before and after it the first and the last one go on."""
    sample = int(min(max(np.floor(at), 0.0), len(held) - 1.0))
    return sums[sample, joint] + (at - sample) * held[sample, joint]


@numba.njit
def _screws(axis: np.ndarray, anchor: np.ndarray, slides: np.ndarray) -> np.ndarray:
    """Motions of the joints at unit speed, shape (k, 6)."""
    screw = np.zeros((len(axis), 6))
    for i in range(len(axis)):
        if slides[i]:
            screw[i, 3:] = axis[i]
        else:
            screw[i, :3] = axis[i]
            _add_cross(anchor[i], axis[i], screw[i, 3:])
    return screw


@numba.njit
def _made(law: np.ndarray, own: np.ndarray, position_rad: float, velocity_rad_s: float) -> float:
    """Torque that a joint's controller makes of what is reported; none where its law is not known."""
    asked = (
        own[_OF_GAIN] * law[_GAIN] * (law[_TARGET] - position_rad - own[_OFFSET]) - law[_BRAKE] * velocity_rad_s + law[_DESIRED]
    )
    made = min(max(asked, -law[_LIMIT]), law[_LIMIT]) - law[_BACK_EMF] * velocity_rad_s
    return 0.0 if np.isnan(made) else made


@numba.njit
def _delayed(line: np.ndarray, now: int, steps: float, joint: int) -> float:
    """What was made some steps ago, of a line that goes round; between two of them by straight line."""
    back = int(np.floor(steps + 1e-9))
    newer, older = line[max(0, now - back) % len(line), joint], line[max(0, now - back - 1) % len(line), joint]
    return newer + (steps - back) * (older - newer)


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
    begins: np.ndarray,
    window: np.ndarray,
    which: np.ndarray,
    found: np.ndarray,
) -> None:
    k, samples = found.shape[2], found.shape[1]
    screw = _screws(axis, anchor, slides)
    turn, move, away = np.empty((k, 3, 3)), np.empty((k, 3)), np.empty(k)
    room, two, whole = np.empty((5, k, 6)), np.empty((2, 6)), np.empty((k, 10))
    mass, lower, inverse = np.empty((k, k)), np.zeros((k, k)), np.empty((k, k))
    load, arrived, value, bound, rest, impulse = np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.empty(k)
    late = int(np.ceil(max(0.0, joints[_LATE].max()) / step_s + 1e-9)) + 3
    line, made, before, memory = np.zeros((late, k)), np.zeros(k), np.empty(k), np.empty((k, 3))
    gained = np.empty(k)  # by velocities in the last step: they are those of half a step ago
    for n in range(len(window)):
        w, m = window[n], which[n]
        own, q, v = joints[:, m], begins[n, 0] - joints[_OFFSET, m], begins[n, 1].copy()
        impulse[:], gained[:] = 0.0, 0.0
        for j in range(k):
            memory[j, 0], memory[j, 1], memory[j, 2] = begins[n, 2, j], v[j], 0.0
            before[j] = _until(-(own[_LATE, j] + 0.5 * step_s) / sample_s, sums[w], sent[w], j)
        is_fine = True
        for now in range(samples * substeps):
            sample = now // substeps
            for j in range(k):
                if is_known[j]:
                    if held_steps == 0 or now % held_steps == 0:
                        made[j] = _made(feedback[:, w, sample, j], own[:, j], q[j], v[j] + 0.5 * gained[j])
                    line[now % late, j] = made[j]
                    # a step moves velocities by what acts half a step before and after its begin
                    arrived[j] = _delayed(line, now, max(0.0, own[_LATE, j] / step_s + 0.5 * (held_steps > 0)), j)
                else:
                    at = ((now + 1) * step_s - own[_LATE, j] - 0.5 * step_s) / sample_s
                    until = _until(at, sums[w], sent[w], j)
                    arrived[j] = (until - before[j]) * (sample_s / step_s)
                    before[j] = until
                away[j] = q[j] - first[j]
            _place(away, axis, anchor, slides, turn, move)
            _loads(v, gravity[m], parent, screw, turn, move, inertias[m], room, load)
            _masses(parent, screw, turn, move, inertias[m], whole, two, mass)
            total = np.abs(arrived).sum()
            for j in range(k):
                _, value[j], bound[j] = sent_to_joint(arrived[j], total, q[j], v[j], load[j], step_s, motors[m, j], memory[j])
                spring = own[_STIFFNESS, j] * (own[_REST, j] - q[j])
                rest[j] = step_s * (value[j] + spring - own[_DAMPING, j] * v[j] - load[j])
                mass[j, j] += own[_ARMATURE, j] + step_s * own[_DAMPING, j]
            _inverted(mass, lower, inverse)
            fastest = 0.0
            gained[:] = v
            for i in range(k):
                for j in range(k):
                    v[i] += inverse[i, j] * rest[j]
            _rub(inverse, bound, step_s, v, impulse)
            for j in range(k):
                q[j] += step_s * v[j]
                gained[j] = v[j] - gained[j]
                fastest = max(fastest, abs(v[j]))
            if not fastest < _DIVERGED:
                is_fine = False
                break
            if now % substeps == substeps - 1:
                for j in range(k):
                    found[n, sample, j] = q[j] + own[_OFFSET, j]
        if not is_fine:
            found[n] = np.nan


@functools.cache
def simulate() -> Callable[..., None]:
    """Simulate n stretches, compiled, without the interpreter's lock; ``found`` is filled in, NaN where a simulation diverges.

    Its arguments, of w windows, m models and k joints in the order of their tree: torques that were recorded (w, s, k) and their
    sums (w, s + 1, k), a controller's law (6, w, s, k), which joints it drives (k,); inertias of the links (m, k, 10), gravity
    (m, 3), armature, damping, stiffness, rest, offset of the encoder, lateness of what is sent and share of the controller's gain
    (7, m, k), the motor law's values (m, k, p); parents (k,), axes and anchors (k, 3), which joints slide, where joints are at
    first (k,); the step, steps to a sample, the time between samples, steps for which a controller holds its torque; begins (n,
    3, k): places, speeds and warmth of the motors, windows and models (n,), and the positions after each sample (n, s, k).
    """
    f1, f2, f3, f4 = (types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1], types.float64[:, :, :, ::1])
    i1, b1 = types.int64[::1], types.boolean[::1]
    of_windows = (f3, f3, f4, b1)
    of_models = (f3, f2, f3, f3, i1, f2, f2, b1, f1)
    of_time = (types.float64, types.int64, types.float64, types.int64)
    signature = types.void(*of_windows, *of_models, *of_time, f3, i1, i1, f3)
    return compiled_once(lambda cache: numba.njit(signature, cache=cache, nogil=True)(_simulate), motor_law.__file__)
