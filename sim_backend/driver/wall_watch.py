"""Which parts of the wall a step has to look at: those that something could touch before the next look.

Looking for contacts with the wall's 48 boxes takes a third of a step where nothing is near them. The control callback of a robot
that has a model of its own looks at the finger's and the object's geoms and switches the wall's eight bodies off and on. What the
solver gets stays the same to the bit: a part is off only while nothing can reach it.
"""

import math

import numba
import numpy as np

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.scene import CUBE_BITS, FINGER_BITS, WALL_PARTS

TOUCHING_BITS = CUBE_BITS | FINGER_BITS
_SPHERE, _CAPSULE, _BOX = 2, 3, 6  # mjtGeom

((_RADIUS_M, _BOTTOM_M), (_UPPER_RADIUS_M, _EDGE_M), (_TOP_RADIUS_M, _TOP_M)) = c.WALL_PROFILE_M
assert _RADIUS_M == _UPPER_RADIUS_M and _TOP_RADIUS_M > _RADIUS_M, "a ring below a cone that opens"
_WIDENING = (_TOP_RADIUS_M - _RADIUS_M) / (_TOP_M - _EDGE_M)
_COSINE = 1.0 / math.hypot(1.0, _WIDENING)

NEAR_M = 0.005
"""A contact begins at no distance; this is for what a blow adds to the speeds within a step."""
_ASTRIDE_M = 0.02
"""By so much at most a cone's boxes, as wide as its top, stand over the sides of their part."""
_SEGMENT_RAD = 2 * math.pi / c.WALL_SEGMENTS
_FIRST_SIDE_RAD = (np.arange(WALL_PARTS) * (c.WALL_SEGMENTS // WALL_PARTS) - 0.5) * _SEGMENT_RAD
_SIDES = np.stack(
    [
        np.sin(_FIRST_SIDE_RAD),
        -np.cos(_FIRST_SIDE_RAD),
        -np.sin(_FIRST_SIDE_RAD + 2 * math.pi / WALL_PARTS),
        np.cos(_FIRST_SIDE_RAD + 2 * math.pi / WALL_PARTS),
    ],
    axis=1,
)
"""Outward normals of the two sides of each part's sector, shape (parts, 4)."""
_REACH_M = 0.45
"""No point of a finger is farther from an axis of its joints."""
_OBJECT_REACH_M = 0.15
"""Nor any of an object from its centre."""


@numba.njit
def reach_m(velocity: np.ndarray, step_s: float) -> float:
    """How far anything may come in a step, with speeds twice as large as they are; generalised velocities of shape (15,)."""
    fastest = 0.0
    for finger in range(3):
        turning = abs(velocity[3 * finger]) + abs(velocity[3 * finger + 1]) + abs(velocity[3 * finger + 2])
        fastest = max(fastest, turning * _REACH_M)
    along = math.sqrt(velocity[9] ** 2 + velocity[10] ** 2 + velocity[11] ** 2)
    around = math.sqrt(velocity[12] ** 2 + velocity[13] ** 2 + velocity[14] ** 2)
    return NEAR_M + 2.0 * step_s * max(fastest, along + around * _OBJECT_REACH_M)


@numba.njit
def clearance_m(kind: int, size: np.ndarray, radius_m: float, position: np.ndarray, turn: np.ndarray, within_m: float) -> float:
    """A distance that a geom has from the wall at least; negative where it may touch it.

    The wall lies beyond the ring's radius and beyond the cone, both of which are convex from outside, so that the points of a
    geom that stick out decide.

    Args:
        kind: MuJoCo's type of geom.
        size: of it, shape (3,), m.
        radius_m: of the sphere around it.
        position: in the world, shape (3,), m.
        turn: rotation matrix, shape (9,).
        within_m: nothing is to be looked at more closely beyond this distance.
    """
    away = math.hypot(position[0], position[1])
    outside = max(_RADIUS_M - away, (_RADIUS_M + _WIDENING * (position[2] - _EDGE_M) - away) * _COSINE) - radius_m
    if outside > within_m or kind not in (_CAPSULE, _BOX):
        return outside
    ring, cone = math.inf, math.inf
    a, b = (0.0, 0.0) if kind == _CAPSULE else (size[0], size[1])
    along = size[1] if kind == _CAPSULE else size[2]
    for corner in range(2 if kind == _CAPSULE else 8):
        u, v, w = along * (2 * (corner & 1) - 1), a * ((corner & 2) - 1), b * ((corner & 4) / 2 - 1)
        x = position[0] + turn[2] * u + turn[0] * v + turn[1] * w
        y = position[1] + turn[5] * u + turn[3] * v + turn[4] * w
        z = position[2] + turn[8] * u + turn[6] * v + turn[7] * w
        away = math.hypot(x, y)
        ring, cone = min(ring, _RADIUS_M - away), min(cone, (_RADIUS_M + _WIDENING * (z - _EDGE_M) - away) * _COSINE)
    return max(ring, cone) - (size[0] if kind == _CAPSULE else 0.0)


@numba.njit
def look(
    first: int,
    kinds: np.ndarray,
    contype: np.ndarray,
    sizes: np.ndarray,
    radii_m: np.ndarray,
    positions: np.ndarray,
    turns: np.ndarray,
    within_m: float,
    bits: np.ndarray,
) -> None:
    """Set which parts of the wall may be touched.

    Args:
        first: the first geom after the wall's.
        kinds: of all geoms, shape (n,).
        contype: of all geoms, shape (n,).
        sizes: shape (n, 3), m.
        radii_m: of the spheres around them, shape (n,).
        positions: shape (n, 3), m.
        turns: shape (n, 9).
        within_m: from this distance on; see :func:`reach_m`.
        bits: filled with 1 for each part that may be touched and 0 for others, shape (parts,).
    """
    bits[:] = 0
    for geom in range(first, len(kinds)):
        if contype[geom] & TOUCHING_BITS == 0:
            continue
        if clearance_m(kinds[geom], sizes[geom], radii_m[geom], positions[geom], turns[geom], within_m) > within_m:
            continue
        x, y, wide = positions[geom, 0], positions[geom, 1], radii_m[geom] + within_m + _ASTRIDE_M
        for part in range(WALL_PARTS):
            left, right = x * _SIDES[part, 0] + y * _SIDES[part, 1], x * _SIDES[part, 2] + y * _SIDES[part, 3]
            if left <= wide and right <= wide:
                bits[part] = 1
