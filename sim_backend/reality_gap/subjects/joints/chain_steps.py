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

_compiled = numba.njit(error_model="numpy")  # slices of arrays cost more than the arithmetic: functions take rows by number


@_compiled
def _add_cross(a: np.ndarray, i: int, m: int, b: np.ndarray, j: int, n: int, out: np.ndarray, o: int, q: int) -> None:
    """Add the product of three numbers of row ``i`` of ``a``, from ``m`` on, with such of ``b``."""
    x, y, z = a[i, m], a[i, m + 1], a[i, m + 2]
    u, v, w = b[j, n], b[j, n + 1], b[j, n + 2]
    out[o, q] += y * w - z * v
    out[o, q + 1] += z * u - x * w
    out[o, q + 2] += x * v - y * u


@_compiled
def _into_child(turn: np.ndarray, move: np.ndarray, i: int, motion: np.ndarray, p: int) -> None:
    """Motion ``p``, in the frame of link i's parent, in that of the link, as motion i; shape (k + 1, 6)."""
    u, v, w = motion[p, 0], motion[p, 1], motion[p, 2]
    x = motion[p, 3] + v * move[i, 2] - w * move[i, 1]
    y = motion[p, 4] + w * move[i, 0] - u * move[i, 2]
    z = motion[p, 5] + u * move[i, 1] - v * move[i, 0]
    for a in range(3):
        motion[i, a] = turn[i, 0, a] * u + turn[i, 1, a] * v + turn[i, 2, a] * w
        motion[i, 3 + a] = turn[i, 0, a] * x + turn[i, 1, a] * y + turn[i, 2, a] * z


@_compiled
def _add_into_parent(turn: np.ndarray, move: np.ndarray, i: int, force: np.ndarray, f: int, out: np.ndarray, p: int) -> None:
    """Add force ``f``, in the frame of link i, to force ``p`` in that of its parent; shapes (..., 6)."""
    u, v, w = force[f, 0], force[f, 1], force[f, 2]
    a, b, c = force[f, 3], force[f, 4], force[f, 5]
    x = turn[i, 0, 0] * a + turn[i, 0, 1] * b + turn[i, 0, 2] * c
    y = turn[i, 1, 0] * a + turn[i, 1, 1] * b + turn[i, 1, 2] * c
    z = turn[i, 2, 0] * a + turn[i, 2, 1] * b + turn[i, 2, 2] * c
    mx, my, mz = move[i, 0], move[i, 1], move[i, 2]
    out[p, 0] += turn[i, 0, 0] * u + turn[i, 0, 1] * v + turn[i, 0, 2] * w + my * z - mz * y
    out[p, 1] += turn[i, 1, 0] * u + turn[i, 1, 1] * v + turn[i, 1, 2] * w + mz * x - mx * z
    out[p, 2] += turn[i, 2, 0] * u + turn[i, 2, 1] * v + turn[i, 2, 2] * w + mx * y - my * x
    out[p, 3] += x
    out[p, 4] += y
    out[p, 5] += z


@_compiled
def _times(inertia: np.ndarray, i: int, motion: np.ndarray, n: int, out: np.ndarray, o: int) -> None:
    """Force ``o`` that inertia ``i`` needs for acceleration ``n``, or momentum of a motion."""
    m, cx, cy, cz = inertia[i, 0], inertia[i, 1], inertia[i, 2], inertia[i, 3]
    xy, xz, yz = inertia[i, 7], inertia[i, 8], inertia[i, 9]
    wx, wy, wz, vx, vy, vz = motion[n, 0], motion[n, 1], motion[n, 2], motion[n, 3], motion[n, 4], motion[n, 5]
    out[o, 0] = inertia[i, 4] * wx + xy * wy + xz * wz + cy * vz - cz * vy
    out[o, 1] = xy * wx + inertia[i, 5] * wy + yz * wz + cz * vx - cx * vz
    out[o, 2] = xz * wx + yz * wy + inertia[i, 6] * wz + cx * vy - cy * vx
    out[o, 3] = m * vx + wy * cz - wz * cy
    out[o, 4] = m * vy + wz * cx - wx * cz
    out[o, 5] = m * vz + wx * cy - wy * cx


@_compiled
def _add_inertia_to_parent(turn: np.ndarray, move: np.ndarray, i: int, whole: np.ndarray, p: int) -> None:
    """Add inertia ``i``, in the frame of that link, to that of its parent, ``p``, in its frame; shape (k, 10)."""
    m = whole[i, 0]
    a, b, c = turn[i, 0, 0], turn[i, 0, 1], turn[i, 0, 2]
    d, e, f = turn[i, 1, 0], turn[i, 1, 1], turn[i, 1, 2]
    g, h, o = turn[i, 2, 0], turn[i, 2, 1], turn[i, 2, 2]
    x = a * whole[i, 1] + b * whole[i, 2] + c * whole[i, 3]
    y = d * whole[i, 1] + e * whole[i, 2] + f * whole[i, 3]
    z = g * whole[i, 1] + h * whole[i, 2] + o * whole[i, 3]
    tx, ty, tz = move[i, 0], move[i, 1], move[i, 2]
    pa, pb, pc, pab, pac, pbc = whole[i, 4], whole[i, 5], whole[i, 6], whole[i, 7], whole[i, 8], whole[i, 9]
    # rows of the turn times the moments
    xa, xb, xc = a * pa + b * pab + c * pac, a * pab + b * pb + c * pbc, a * pac + b * pbc + c * pc
    ya, yb, yc = d * pa + e * pab + f * pac, d * pab + e * pb + f * pbc, d * pac + e * pbc + f * pc
    za, zb, zc = g * pa + h * pab + o * pac, g * pab + h * pb + o * pbc, g * pac + h * pbc + o * pc
    square = m * (tx * tx + ty * ty + tz * tz) + 2.0 * (x * tx + y * ty + z * tz)
    whole[p, 0] += m
    whole[p, 1] += x + m * tx
    whole[p, 2] += y + m * ty
    whole[p, 3] += z + m * tz
    whole[p, 4] += xa * a + xb * b + xc * c + square - (2.0 * x * tx + m * tx * tx)
    whole[p, 5] += ya * d + yb * e + yc * f + square - (2.0 * y * ty + m * ty * ty)
    whole[p, 6] += za * g + zb * h + zc * o + square - (2.0 * z * tz + m * tz * tz)
    whole[p, 7] += xa * d + xb * e + xc * f - (x * ty + y * tx + m * tx * ty)
    whole[p, 8] += xa * g + xb * h + xc * o - (x * tz + z * tx + m * tx * tz)
    whole[p, 9] += ya * g + yb * h + yc * o - (y * tz + z * ty + m * ty * tz)


@_compiled
def _place(
    position: np.ndarray, axis: np.ndarray, anchor: np.ndarray, slides: np.ndarray, turn: np.ndarray, move: np.ndarray
) -> None:
    """Frames of k links in those of their parents, by how far joints are from where the model has them at first."""
    for i in range(len(position)):
        x, y, z, by = axis[i, 0], axis[i, 1], axis[i, 2], position[i]
        if slides[i]:
            for a in range(3):
                for b in range(3):
                    turn[i, a, b] = 1.0 if a == b else 0.0
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


@_compiled
def _loads(
    velocity: np.ndarray,
    parent: np.ndarray,
    screw: np.ndarray,
    turn: np.ndarray,
    move: np.ndarray,
    inertia: np.ndarray,
    moves: np.ndarray,
    faster: np.ndarray,
    forces: np.ndarray,
    load: np.ndarray,
) -> None:
    """What gravity and motion ask of the joints, shape (k,), by Newton and Euler.

    ``moves`` and ``faster`` of shape (k + 1, 6) have the world's motion and acceleration as their last rows, their others and
    ``forces`` (k + 1, 6) are overwritten.
    """
    k = len(velocity)
    for i in range(k):
        before = parent[i] if parent[i] >= 0 else k
        _into_child(turn, move, i, moves, before)
        _into_child(turn, move, i, faster, before)
        for a in range(6):
            own = screw[i, a] * velocity[i]
            moves[i, a] += own
            forces[k, a] = own
        _add_cross(moves, i, 0, forces, k, 0, faster, i, 0)
        _add_cross(moves, i, 0, forces, k, 3, faster, i, 3)
        _add_cross(moves, i, 3, forces, k, 0, faster, i, 3)
        _times(inertia, i, moves, i, forces, k)
        _times(inertia, i, faster, i, forces, i)
        _add_cross(moves, i, 0, forces, k, 0, forces, i, 0)
        _add_cross(moves, i, 3, forces, k, 3, forces, i, 0)
        _add_cross(moves, i, 0, forces, k, 3, forces, i, 3)
    for i in range(k - 1, -1, -1):
        total = 0.0
        for a in range(6):
            total += screw[i, a] * forces[i, a]
        load[i] = total
        if parent[i] >= 0:
            _add_into_parent(turn, move, i, forces, i, forces, parent[i])


@_compiled
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
    for i in range(k):
        for a in range(10):
            whole[i, a] = inertia[i, a]
    for i in range(k - 1, -1, -1):
        if parent[i] >= 0:
            _add_inertia_to_parent(turn, move, i, whole, parent[i])
    for i in range(k):
        now = 0
        _times(whole, i, screw, i, room, now)
        j = i
        while True:
            total = 0.0
            for a in range(6):
                total += screw[j, a] * room[now, a]
            out[i, j] = out[j, i] = total
            if parent[j] < 0:
                break
            for a in range(6):
                room[1 - now, a] = 0.0
            _add_into_parent(turn, move, j, room, now, room, 1 - now)
            now, j = 1 - now, parent[j]


@_compiled
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


@_compiled
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


@_compiled
def _moved_on(
    inverse: np.ndarray,
    rest: np.ndarray,
    bound: np.ndarray,
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
    _rub(inverse, bound, step_s, velocity, impulse)
    for j in range(k):
        position[j] += step_s * velocity[j]
        gained[j] = velocity[j] - gained[j]
        fastest = max(fastest, abs(velocity[j]))
    return fastest < _DIVERGED


@_compiled
def _until(at: float, sums: np.ndarray, held: np.ndarray, window: int, joint: int) -> float:
    """Integral of what has arrived of a recorded torque, in samples; before and after it the first and the last one go on."""
    sample = int(min(max(np.floor(at), 0.0), held.shape[1] - 1.0))
    return sums[window, sample, joint] + (at - sample) * held[window, sample, joint]


@_compiled
def _screws(axis: np.ndarray, anchor: np.ndarray, slides: np.ndarray) -> np.ndarray:
    """Motions of the joints at unit speed, shape (k, 6)."""
    screw = np.zeros((len(axis), 6))
    for i in range(len(axis)):
        if slides[i]:
            screw[i, 3:] = axis[i]
        else:
            screw[i, :3] = axis[i]
            _add_cross(anchor, i, 0, axis, i, 0, screw, i, 3)
    return screw


@_compiled
def _made(
    feedback: np.ndarray, w: int, sample: int, joint: int, gain: float, position_rad: float, velocity_rad_s: float
) -> float:
    """Torque that a joint's controller makes of what is reported, with a share of its gain; none where its law is not known."""
    stiffness = gain * feedback[_GAIN, w, sample, joint]
    asked = stiffness * (feedback[_TARGET, w, sample, joint] - position_rad) - feedback[_BRAKE, w, sample, joint] * velocity_rad_s
    asked += feedback[_DESIRED, w, sample, joint]
    limit = feedback[_LIMIT, w, sample, joint]
    made = min(max(asked, -limit), limit) - feedback[_BACK_EMF, w, sample, joint] * velocity_rad_s
    return 0.0 if np.isnan(made) else made


@_compiled
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
    moves, faster, forces = np.zeros((k + 1, 6)), np.zeros((k + 1, 6)), np.empty((k + 1, 6))
    two, whole = np.empty((2, 6)), np.empty((k, 10))
    mass, lower, inverse = np.zeros((k, k)), np.empty((k, k)), np.empty((k, k))
    load, arrived, value, bound, rest, impulse = np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.empty(k)
    late = int(np.ceil(max(0.0, joints[_LATE].max()) / step_s + 1e-9)) + 3
    line, made, before, memory = np.zeros((late, k)), np.zeros(k), np.empty(k), np.empty((k, 3))
    q, v = np.empty(k), np.empty(k)
    gained = np.empty(k)  # by velocities in the last step: they are those of half a step ago
    for n in range(len(window)):
        w, m = window[n], which[n]
        inertia, of_motors = inertias[m], motors[m]
        for a in range(3):
            faster[k, 3 + a] = -gravity[m, a]
        for j in range(k):
            q[j], v[j], impulse[j], gained[j] = begins[n, 0, j] - joints[_OFFSET, m, j], begins[n, 1, j], 0.0, 0.0
            memory[j, 0], memory[j, 1], memory[j, 2] = begins[n, 2, j], v[j], 0.0
            before[j] = _until(-(joints[_LATE, m, j] + 0.5 * step_s) / sample_s, sums, sent, w, j)
        now, is_fine = 0, True
        for sample in range(samples):
            for _ in range(substeps):
                total = 0.0
                for j in range(k):
                    if is_known[j]:
                        if held_steps == 0 or now % held_steps == 0:
                            reported = q[j] + joints[_OFFSET, m, j]
                            made[j] = _made(feedback, w, sample, j, joints[_OF_GAIN, m, j], reported, v[j] + 0.5 * gained[j])
                        line[now % late, j] = made[j]
                        # a step moves velocities by what acts half a step before and after its begin
                        arrived[j] = _delayed(line, now, max(0.0, joints[_LATE, m, j] / step_s + 0.5 * (held_steps > 0)), j)
                    else:
                        until = _until(((now + 1) * step_s - joints[_LATE, m, j] - 0.5 * step_s) / sample_s, sums, sent, w, j)
                        arrived[j] = (until - before[j]) * (sample_s / step_s)
                        before[j] = until
                    total += abs(arrived[j])
                    away[j] = q[j] - first[j]
                _place(away, axis, anchor, slides, turn, move)
                _loads(v, parent, screw, turn, move, inertia, moves, faster, forces, load)
                _masses(parent, screw, turn, move, inertia, whole, two, mass)
                for j in range(k):
                    _, value[j], bound[j] = sent_to_joint(arrived[j], total, q[j], v[j], load[j], step_s, of_motors, memory, j)
                    spring = joints[_STIFFNESS, m, j] * (joints[_REST, m, j] - q[j])
                    rest[j] = step_s * (value[j] + spring - joints[_DAMPING, m, j] * v[j] - load[j])
                    mass[j, j] += joints[_ARMATURE, m, j] + step_s * joints[_DAMPING, m, j]
                _inverted(mass, lower, inverse)
                is_fine = _moved_on(inverse, rest, bound, step_s, q, v, gained, impulse)
                if not is_fine:
                    break
                now += 1
            if not is_fine:
                break
            for j in range(k):
                found[n, sample, j] = q[j] + joints[_OFFSET, m, j]
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
    return compiled_once(
        lambda cache: numba.njit(signature, cache=cache, nogil=True, error_model="numpy")(_simulate), motor_law.__file__
    )
