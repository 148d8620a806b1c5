"""Which finger takes which face of the cube, and where: all ways are weighed, the most secure that can be reached is taken."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import permutations, product

import numpy as np

from sim_backend.grasping.carrying import UP_M as LIFTED_M
from sim_backend.grasping.hand import gravity_torque_nm, tip_jacobian
from sim_backend.grasping.turning import LARGEST_RAD, about_vertical, parts_of
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
BELOW_M = 0.03
"""Nearer to the place below its goal, a cube is there."""
JOINT_MARGIN_RAD = 0.03
WALL_MARGIN_M = 0.001
LINK_RADIUS_M = 0.011
USABLE_TORQUE_NM = 0.9 * c.MAX_TORQUE_NM
SECURE_N = 0.6
"""Less secure, a grasp is to turn the cube less."""
LARGEST_FORCE_N = 2.5
LEAST_FRICTION, CENTRE_ERROR_M = 0.5, 0.004
WEIGHED = 48
"""Ways whose security is weighed, of those that can be reached: the ones with the strongest weakest finger."""


@dataclass(frozen=True)
class Grasp:
    """Where three fingertips hold a cube.

    ``tip_m`` (3, 3) are the centres of the tips relative to the cube's centre along the world's axes, m; ``inward`` (3, 3) the
    directions in which they press; ``force_n`` (3,) with what force at most. ``clearance_m`` is how far from the faces they get
    ready, ``measure_n`` how secure the grasp is (``wrench.py``), ``goal_m`` (3,) where the cube can be carried with it,
    ``turn_rad`` how far it is turned about the vertical meanwhile, ``unfinished`` whether another grasp is to turn it further.
    """

    tip_m: np.ndarray
    inward: np.ndarray
    force_n: np.ndarray
    clearance_m: float
    measure_n: float
    goal_m: np.ndarray
    turn_rad: float = 0.0
    unfinished: bool = False

    def turned(self, angle_rad: float) -> "Grasp":
        """The same grasp of a cube that was turned since."""
        return replace(self, tip_m=_turned(self.tip_m, angle_rad), inward=_turned(self.inward, angle_rad))


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


def choose_grasp(
    cube_m: np.ndarray, normals: np.ndarray, goal_m: np.ndarray, rank: int = 0, turn_rad: float = 0.0
) -> Grasp | None:
    """The most secure grasp that can be reached where the cube is and where it is to go, of those that turn it furthest.

    Where no grasp that turns it so far is secure, one that turns it less, or the most secure of all.

    Args:
        cube_m: the cube's centre, shape (3,), m.
        normals: from :func:`side_normals`.
        goal_m: where the centre is to go, shape (3,), m.
        rank: 0 for the best, 1 for the next best with other faces, ...
        turn_rad: how far the cube is to be turned about the vertical.

    Returns:
        None if there is none.
    """
    faces, aside, up = _ways()
    outward = normals[faces]  # (N, 3 fingers, 3)
    along = np.stack([-outward[..., 1], outward[..., 0], np.zeros(faces.shape)], axis=-1)
    tip = outward * HELD_OUT_M + along * aside[..., None]
    tip[..., 2] = up[:, None]
    held = _reached(cube_m + tip, cube_m, normals)
    ready = [np.flatnonzero(held & _reached(cube_m + tip + outward * each, cube_m, normals)) for each in CLEARANCES_M]
    found = None
    for plan in _plans(cube_m, goal_m, turn_rad):
        if (at := _first_in_reach(plan, ready, tip, normals, cube_m)) is None:
            continue
        ways, clearance, there_m = at
        inward = -outward[ways]
        force = np.minimum(
            _largest_force_n(cube_m + tip[ways], inward),
            _largest_force_n(plan.goal_m + _turned(tip[ways], plan.turn_rad), _turned(inward, plan.turn_rad)),
        )
        keep = np.argsort(-force.min(axis=1), kind="stable")[:WEIGHED]
        contact = tip[ways][keep] + inward[keep] * c.TIP_RADIUS_M
        measure = robust_wrench_measure(contact, inward[keep], force[keep], LEAST_FRICTION, CENTRE_ERROR_M)
        index = _of_rank(np.argsort(-measure, kind="stable"), faces[ways][keep], rank)
        best, measure_n = keep[index], float(measure[index])
        if found is None or measure_n > found.measure_n:
            way = tip[ways[best]], inward[best], force[best], clearance, measure_n
            found = Grasp(*way, there_m, plan.turn_rad, plan.unfinished)
        if measure_n > SECURE_N:
            break
    return found


@dataclass(frozen=True)
class _Plan:
    """Where a grasp is to bring the cube and how far it is to turn it, and whether another grasp is to go on from there."""

    goal_m: np.ndarray
    turn_rad: float
    unfinished: bool = False


def _plans(cube_m: np.ndarray, goal_m: np.ndarray, turn_rad: float) -> Iterator[_Plan]:
    """All at once; else as much of the turn as can be, down to the floor below the goal; else no turn."""
    if abs(turn_rad) <= LARGEST_RAD:
        yield _Plan(goal_m, turn_rad)
    floor_m = np.array([*goal_m[:2], c.CUBE_REST_HEIGHT_M])
    yield from (_Plan(floor_m, part, unfinished=True) for part in parts_of(turn_rad))
    if turn_rad:
        if np.linalg.norm(cube_m - floor_m) > BELOW_M:
            yield _Plan(floor_m, 0.0, unfinished=True)
        yield _Plan(goal_m, 0.0)


def _first_in_reach(
    plan: _Plan, ready: list[np.ndarray], tip: np.ndarray, normals: np.ndarray, cube_m: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray] | None:
    """Ways that can do what is planned, (n,), from which distance they get ready, m, and where they bring the cube, (3,), m."""
    for (ways, clearance), nearer_m in product(zip(ready, CLEARANCES_M, strict=True), NEARER_M):
        there_m = _nearer(plan.goal_m, nearer_m)
        found = ways[_turned_there(tip[ways], normals, cube_m, there_m, plan.turn_rad)]
        if len(found):
            return found, clearance, there_m
    return None


def _turned_there(tip_m: np.ndarray, normals: np.ndarray, cube_m: np.ndarray, there_m: np.ndarray, turn_rad: float) -> np.ndarray:
    """Whether tips (N, 3, 3) about the cube can turn it on its way and are in reach at its end, (N,)."""
    good = np.ones(len(tip_m), dtype=bool)
    for share in (1.0, *((0.25, 0.5, 0.75) if turn_rad else ())):
        place_m = cube_m + share * (there_m - cube_m)
        if share < 1:
            place_m = place_m + np.array([0.0, 0.0, LIFTED_M])
        turn = _turned(normals, share * turn_rad)
        good[good] = _reached(place_m + _turned(tip_m[good], share * turn_rad), place_m, turn)
    return good


def carried_to(grasp: Grasp, goal_m: np.ndarray, turn_rad: float = 0.0) -> np.ndarray | None:
    """Where near a goal the cube can be carried, turned so far, with a grasp that holds it; None if nowhere. Shapes (3,), m."""
    grasp = grasp.turned(turn_rad)
    first = -grasp.inward[0]
    second = np.array([-first[1], first[0], 0.0])
    normals = np.array([first, second, -first, -second])
    for nearer_m in NEARER_M:
        there_m = _nearer(goal_m, nearer_m)
        if _reached((there_m + grasp.tip_m)[None], there_m, normals)[0]:
            return there_m
    return None


def _turned(vectors: np.ndarray, angle_rad: float) -> np.ndarray:
    return vectors @ about_vertical(angle_rad).T if angle_rad else vectors


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
