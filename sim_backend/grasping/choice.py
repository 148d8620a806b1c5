"""Which finger takes which face of the cube, and where: all ways are weighed, the most secure that can be reached is taken."""

from dataclasses import dataclass
from functools import cache
from itertools import permutations, product

import numpy as np

from sim_backend.grasping.hand import gravity_torque_nm, tip_jacobian
from sim_backend.grasping.wrench import robust_wrench_measure
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import elbow_position_world_m, joint_position_rad

ASIDE_M = (-0.012, 0.0, 0.012)
"""Contacts tried on a face, from its middle to the sides."""
UP_M = (0.0, 0.012, 0.022)
"""Contacts tried above the middle of the faces; the wall is further away up there."""
CLEARANCES_M = (0.016, 0.006)
"""Between a fingertip that gets ready and the face: the second where the first leaves no way."""
HELD_OUT_M = c.CUBE_WIDTH_M / 2 + c.TIP_RADIUS_M
NEARER_M = (0.0, 0.008)
"""How much further from the wall, and half as much higher, the cube may be let go where the goal itself cannot be reached."""
JOINT_MARGIN_RAD = 0.03
WALL_MARGIN_M = 0.001
LINK_RADIUS_M = 0.011
USABLE_TORQUE_NM = 0.9 * c.MAX_TORQUE_NM
LARGEST_FORCE_N = 2.5
FRICTIONS, CONTACT_ERROR_M = (0.5, 1.0), 0.004
WEIGHED = 48
"""Ways whose security is weighed, of those that can be reached: the ones with the strongest weakest finger."""


@dataclass(frozen=True)
class Grasp:
    """Where three fingertips hold a cube.

    ``tip_m`` (3, 3) are the centres of the tips relative to the cube's centre along the world's axes, m; ``inward`` (3, 3) the
    directions in which they press; ``force_n`` (3,) with what force at most. ``clearance_m`` is how far from the faces they get
    ready, ``measure_n`` how secure the grasp is (``wrench.py``), ``goal_m`` (3,) where the cube can be carried with it.
    """

    tip_m: np.ndarray
    inward: np.ndarray
    force_n: np.ndarray
    clearance_m: float
    measure_n: float
    goal_m: np.ndarray


def side_normals(cube_matrix: np.ndarray) -> np.ndarray | None:
    """The outward normals of the four upright faces, shape (4, 3), one after the other around the cube; None if it is tilted.

    Args:
        cube_matrix: the cube's orientation, shape (3, 3).
    """
    upright = int(np.argmax(np.abs(cube_matrix[2])))
    if abs(cube_matrix[2, upright]) < 0.9:
        return None
    first = cube_matrix[:, (upright + 1) % 3] * [1.0, 1.0, 0.0]
    first /= np.linalg.norm(first)
    second = np.array([-first[1], first[0], 0.0])
    return np.array([first, second, -first, -second])


def choose_grasp(cube_m: np.ndarray, normals: np.ndarray, goal_m: np.ndarray, rank: int = 0) -> Grasp | None:
    """The most secure grasp that can be reached where the cube is and where it is to go.

    Args:
        cube_m: the cube's centre, shape (3,), m.
        normals: from :func:`side_normals`.
        goal_m: where the centre is to go, shape (3,), m.
        rank: 0 for the best, 1 for the next best with other faces, ...

    Returns:
        None if there is none.
    """
    faces, aside, up = _ways()
    outward = normals[faces]  # (N, 3 fingers, 3)
    along = np.stack([-outward[..., 1], outward[..., 0], np.zeros(faces.shape)], axis=-1)
    tip = outward * HELD_OUT_M + along * aside[..., None]
    tip[..., 2] = up[:, None]
    held = _reached(cube_m + tip, cube_m, normals)
    for clearance, nearer_m in product(CLEARANCES_M, NEARER_M):
        there_m = _nearer(goal_m, nearer_m)
        good = held & _reached(there_m + tip, there_m, normals)
        found = np.flatnonzero(good & _reached(cube_m + tip + outward * clearance, cube_m, normals))
        if len(found):
            break
    else:
        return None
    inward = -outward[found]
    force = np.minimum(*(_largest_force_n(place + tip[found], inward) for place in (cube_m, goal_m)))
    keep = np.argsort(-force.min(axis=1), kind="stable")[:WEIGHED]
    contact = tip[found][keep] + inward[keep] * c.TIP_RADIUS_M
    measure = robust_wrench_measure(contact, inward[keep], force[keep], FRICTIONS, CONTACT_ERROR_M)
    index = _of_rank(np.argsort(-measure, kind="stable"), faces[found][keep], rank)
    best = keep[index]
    return Grasp(tip[found][best], inward[best], force[best], clearance, float(measure[index]), there_m)


def carried_to(grasp: Grasp, goal_m: np.ndarray) -> np.ndarray | None:
    """Where near a goal the cube can be carried with a grasp that holds it; None if nowhere. Shapes (3,), m."""
    first = -grasp.inward[0]
    second = np.array([-first[1], first[0], 0.0])
    normals = np.array([first, second, -first, -second])
    for nearer_m in NEARER_M:
        there_m = _nearer(goal_m, nearer_m)
        if _reached((there_m + grasp.tip_m)[None], there_m, normals)[0]:
            return there_m
    return None


def _nearer(goal_m: np.ndarray, by_m: float) -> np.ndarray:
    return goal_m + by_m * np.array([*-goal_m[:2] / max(float(np.linalg.norm(goal_m[:2])), 1e-9), 0.5])


def _of_rank(order: np.ndarray, faces: np.ndarray, rank: int) -> int:
    """The first in the order that comes after ``rank`` other choices of faces, counted round and round."""
    firsts: dict[tuple, int] = {}
    for index in order:
        firsts.setdefault(tuple(faces[index]), int(index))
    return [*firsts.values()][rank % len(firsts)]


@cache
def _ways() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every way: faces of the three fingers (N, 3), how far aside their contacts are (N, 3), m, and how far up (N,), m."""
    faces, aside, up = zip(*product(permutations(range(4), 3), product(ASIDE_M, repeat=3), UP_M), strict=True)
    return np.array(faces), np.array(aside), np.array(up)


def wall_radius_m(height_m: np.ndarray) -> np.ndarray:
    """Inner radius of the arena at a height."""
    radii, heights = zip(*c.WALL_PROFILE_M, strict=True)
    return np.interp(height_m, heights, radii)


def _reached(tip_m: np.ndarray, cube_m: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Whether tips can be at places (N, 3, 3): within joints, wall, and without a link in the cube or in another; (N,)."""
    joints = joint_position_rad(tip_m.reshape(-1, 9))
    with np.errstate(invalid="ignore"):
        inside = (joints > c.SOFT_LIMIT_LOWER_RAD + JOINT_MARGIN_RAD) & (joints < c.SOFT_LIMIT_UPPER_RAD - JOINT_MARGIN_RAD)
    good = inside.all(axis=1)
    radius = np.linalg.norm(tip_m[..., :2], axis=-1)
    good &= (radius < wall_radius_m(tip_m[..., 2]) - c.TIP_RADIUS_M - WALL_MARGIN_M).all(axis=1)
    elbow = elbow_position_world_m(np.nan_to_num(joints)).reshape(-1, 3, 3)
    share = np.linspace(0.2, 0.9, 8)[:, None]
    links = tip_m[:, :, None] + share * (elbow - tip_m)[:, :, None]  # (N, 3, 8, 3)
    good &= ~_in_cube(links, cube_m, normals).any(axis=(1, 2))
    for one, other in ((0, 1), (1, 2), (2, 0)):
        apart = np.linalg.norm(links[:, one, :, None] - links[:, other, None], axis=-1)
        good &= apart.min(axis=(1, 2)) > 2 * LINK_RADIUS_M
    return good


def _in_cube(point_m: np.ndarray, cube_m: np.ndarray, normals: np.ndarray) -> np.ndarray:
    away = point_m - cube_m
    half = c.CUBE_WIDTH_M / 2 + LINK_RADIUS_M
    return (np.abs(away @ normals[0]) < half) & (np.abs(away @ normals[1]) < half) & (np.abs(away[..., 2]) < half)


def _largest_force_n(tip_m: np.ndarray, inward: np.ndarray) -> np.ndarray:
    """With what force each finger can press there, beside holding itself up; shapes (N, 3, 3) to (N, 3), N."""
    joints = joint_position_rad(tip_m.reshape(-1, 9))
    own = gravity_torque_nm(joints).reshape(-1, 3, 3)
    per_newton = np.einsum("nfcj,nfc->nfj", tip_jacobian(joints), inward)
    with np.errstate(divide="ignore"):
        left = np.where(per_newton > 0, USABLE_TORQUE_NM - own, USABLE_TORQUE_NM + own) / np.abs(per_newton)
    return np.clip(left, 0.0, LARGEST_FORCE_N).min(axis=-1)
