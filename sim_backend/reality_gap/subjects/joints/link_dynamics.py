"""Dynamics of a tree of links, compiled: where links are, what their motion and gravity ask of the joints, and their inertias.

Motions are (angular, linear) at the origin of a link's frame, forces (moment, force) there; an inertia is mass, mass times centre
(3) and the moments xx, yy, zz, xy, xz, yz about the origin. ``turn`` and ``move`` place a link's frame in that of its parent.
"""

import numba
import numpy as np

compiled = numba.njit(error_model="numpy")
"""Slices of arrays cost more than the arithmetic: functions take arrays and the numbers of rows."""


@compiled
def _add_cross(a: np.ndarray, i: int, m: int, b: np.ndarray, j: int, n: int, out: np.ndarray, o: int, q: int) -> None:
    """Add the product of three numbers of row ``i`` of ``a``, from ``m`` on, with such of ``b``."""
    x, y, z = a[i, m], a[i, m + 1], a[i, m + 2]
    u, v, w = b[j, n], b[j, n + 1], b[j, n + 2]
    out[o, q] += y * w - z * v
    out[o, q + 1] += z * u - x * w
    out[o, q + 2] += x * v - y * u


@compiled
def _into_child(turn: np.ndarray, move: np.ndarray, i: int, motion: np.ndarray, p: int) -> None:
    """Motion ``p``, in the frame of link i's parent, in that of the link, as motion i; shape (k + 1, 6)."""
    u, v, w = motion[p, 0], motion[p, 1], motion[p, 2]
    x = motion[p, 3] + v * move[i, 2] - w * move[i, 1]
    y = motion[p, 4] + w * move[i, 0] - u * move[i, 2]
    z = motion[p, 5] + u * move[i, 1] - v * move[i, 0]
    for a in range(3):
        motion[i, a] = turn[i, 0, a] * u + turn[i, 1, a] * v + turn[i, 2, a] * w
        motion[i, 3 + a] = turn[i, 0, a] * x + turn[i, 1, a] * y + turn[i, 2, a] * z


@compiled
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


@compiled
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


@compiled
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


@compiled
def place(
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


@compiled
def loads(
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


@compiled
def masses(
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


@compiled
def screws(axis: np.ndarray, anchor: np.ndarray, slides: np.ndarray) -> np.ndarray:
    """Motions of the joints at unit speed, shape (k, 6)."""
    screw = np.zeros((len(axis), 6))
    for i in range(len(axis)):
        if slides[i]:
            screw[i, 3:] = axis[i]
        else:
            screw[i, :3] = axis[i]
            _add_cross(anchor, i, 0, axis, i, 0, screw, i, 3)
    return screw
