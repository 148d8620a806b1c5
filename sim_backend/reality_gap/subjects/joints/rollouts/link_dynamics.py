"""Dynamics of a tree of links, compiled: where links are, what their motion and gravity ask of the joints, and their inertias.

Motions are (angular, linear) at the origin of a link's frame, forces (moment, force) there; an inertia is mass, mass times centre
(3) and the moments xx, yy, zz, xy, xz, yz about the origin. ``turn`` and ``move`` place a link's frame in that of its parent.
"""

import numba
import numpy as np

compiled = numba.njit(error_model="numpy", _nrt=False, forceinline=True)  # pyrefly: ignore[no-matching-overload]
"""Slices of arrays cost more than the arithmetic: functions take arrays and the numbers of rows, or few numbers as a tuple. They
make no arrays, so that Numba need not count references to those that they are given; counting and calling take more than half of
the time of an arm with few joints.
"""
Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]


@compiled
def _cross(a: Three, b: Three) -> Three:
    """The product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _row(rows: np.ndarray, i: int) -> Six:
    """Row i of shape (n, 6) as numbers, which stay in registers."""
    return rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4], rows[i, 5]


@compiled
def _into_child(turn: np.ndarray, move: np.ndarray, i: int, motion: Six) -> Six:
    """A motion in the frame of link i's parent in that of the link."""
    u, v, w = motion[0], motion[1], motion[2]
    x = motion[3] + v * move[i, 2] - w * move[i, 1]
    y = motion[4] + w * move[i, 0] - u * move[i, 2]
    z = motion[5] + u * move[i, 1] - v * move[i, 0]
    return (
        turn[i, 0, 0] * u + turn[i, 1, 0] * v + turn[i, 2, 0] * w,
        turn[i, 0, 1] * u + turn[i, 1, 1] * v + turn[i, 2, 1] * w,
        turn[i, 0, 2] * u + turn[i, 1, 2] * v + turn[i, 2, 2] * w,
        turn[i, 0, 0] * x + turn[i, 1, 0] * y + turn[i, 2, 0] * z,
        turn[i, 0, 1] * x + turn[i, 1, 1] * y + turn[i, 2, 1] * z,
        turn[i, 0, 2] * x + turn[i, 1, 2] * y + turn[i, 2, 2] * z,
    )


@compiled
def _into_parent(turn: np.ndarray, move: np.ndarray, i: int, force: Six) -> Six:
    """A force in the frame of link i in that of its parent."""
    u, v, w, a, b, c = force
    x = turn[i, 0, 0] * a + turn[i, 0, 1] * b + turn[i, 0, 2] * c
    y = turn[i, 1, 0] * a + turn[i, 1, 1] * b + turn[i, 1, 2] * c
    z = turn[i, 2, 0] * a + turn[i, 2, 1] * b + turn[i, 2, 2] * c
    mx, my, mz = move[i, 0], move[i, 1], move[i, 2]
    return (
        turn[i, 0, 0] * u + turn[i, 0, 1] * v + turn[i, 0, 2] * w + my * z - mz * y,
        turn[i, 1, 0] * u + turn[i, 1, 1] * v + turn[i, 1, 2] * w + mz * x - mx * z,
        turn[i, 2, 0] * u + turn[i, 2, 1] * v + turn[i, 2, 2] * w + mx * y - my * x,
        x,
        y,
        z,
    )


@compiled
def _times(inertia: np.ndarray, i: int, motion: Six) -> Six:
    """The force that inertia ``i`` needs for an acceleration, or momentum of a motion."""
    m, cx, cy, cz = inertia[i, 0], inertia[i, 1], inertia[i, 2], inertia[i, 3]
    xy, xz, yz = inertia[i, 7], inertia[i, 8], inertia[i, 9]
    wx, wy, wz, vx, vy, vz = motion
    return (
        inertia[i, 4] * wx + xy * wy + xz * wz + cy * vz - cz * vy,
        xy * wx + inertia[i, 5] * wy + yz * wz + cz * vx - cx * vz,
        xz * wx + yz * wy + inertia[i, 6] * wz + cx * vy - cy * vx,
        m * vx + wy * cz - wz * cy,
        m * vy + wz * cx - wx * cz,
        m * vz + wx * cy - wy * cx,
    )


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
    ``forces`` (k, 6) are overwritten.
    """
    k = len(velocity)
    for i in range(k):
        before = parent[i] if parent[i] >= 0 else k
        move_of, rate_of = _into_child(turn, move, i, _row(moves, before)), _into_child(turn, move, i, _row(faster, before))
        u, v, w = screw[i, 0] * velocity[i], screw[i, 1] * velocity[i], screw[i, 2] * velocity[i]
        x, y, z = screw[i, 3] * velocity[i], screw[i, 4] * velocity[i], screw[i, 5] * velocity[i]
        spin = move_of[0] + u, move_of[1] + v, move_of[2] + w
        slide = move_of[3] + x, move_of[4] + y, move_of[5] + z
        turned, moved, also = _cross(spin, (u, v, w)), _cross(spin, (x, y, z)), _cross(slide, (u, v, w))
        whole = (spin[0], spin[1], spin[2], slide[0], slide[1], slide[2])
        rate = (
            rate_of[0] + turned[0],
            rate_of[1] + turned[1],
            rate_of[2] + turned[2],
            rate_of[3] + moved[0] + also[0],
            rate_of[4] + moved[1] + also[1],
            rate_of[5] + moved[2] + also[2],
        )
        needs, momentum = _times(inertia, i, rate), _times(inertia, i, whole)
        of_turning, of_moving = (momentum[0], momentum[1], momentum[2]), (momentum[3], momentum[4], momentum[5])
        turned, moved, also = _cross(spin, of_turning), _cross(slide, of_moving), _cross(spin, of_moving)
        for a in range(6):
            moves[i, a], faster[i, a] = whole[a], rate[a]
        for a in range(3):
            forces[i, a] = needs[a] + turned[a] + moved[a]
            forces[i, 3 + a] = needs[3 + a] + also[a]
    for i in range(k - 1, -1, -1):
        total = 0.0
        for a in range(6):
            total += screw[i, a] * forces[i, a]
        load[i] = total
        if parent[i] >= 0:
            passed = _into_parent(turn, move, i, _row(forces, i))
            for a in range(6):
                forces[parent[i], a] += passed[a]


@compiled
def masses(
    parent: np.ndarray,
    screw: np.ndarray,
    turn: np.ndarray,
    move: np.ndarray,
    inertia: np.ndarray,
    whole: np.ndarray,
    out: np.ndarray,
) -> None:
    """Inertia of the joints, shape (k, k), by composite bodies; ``whole`` (k, 10) is overwritten."""
    k = len(parent)
    for i in range(k):
        for a in range(10):
            whole[i, a] = inertia[i, a]
    for i in range(k - 1, -1, -1):
        if parent[i] >= 0:
            _add_inertia_to_parent(turn, move, i, whole, parent[i])
    for i in range(k):
        force, j = _times(whole, i, _row(screw, i)), i
        while True:
            u, v, w, a, b, c = force
            total = screw[j, 0] * u + screw[j, 1] * v + screw[j, 2] * w + screw[j, 3] * a + screw[j, 4] * b + screw[j, 5] * c
            out[i, j] = out[j, i] = total
            if parent[j] < 0:
                break
            force, j = _into_parent(turn, move, j, force), parent[j]


@numba.njit(error_model="numpy")
def screws(axis: np.ndarray, anchor: np.ndarray, slides: np.ndarray) -> np.ndarray:
    """Motions of the joints at unit speed, shape (k, 6)."""
    screw = np.zeros((len(axis), 6))
    for i in range(len(axis)):
        if slides[i]:
            screw[i, 3:] = axis[i]
        else:
            screw[i, :3] = axis[i]
            x, y, z = _cross((anchor[i, 0], anchor[i, 1], anchor[i, 2]), (axis[i, 0], axis[i, 1], axis[i, 2]))
            screw[i, 3], screw[i, 4], screw[i, 5] = x, y, z
    return screw
