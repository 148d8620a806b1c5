"""Pushing the object and letting it slide: one finger after the other goes behind it, thrusts and draws back."""

from dataclasses import dataclass

import numpy as np

from sim_backend.driver.driver import Command
from sim_backend.excitations.course import COMMAND_STEPS, Course, Sight, commands, eased, follow, glide, hold
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import elbow_position_world_m, fingertip_position_world_m, joint_position_rad

DURATION_S = 40.0
MAX_START_RADIUS_M = 0.09
"""Wherever the object lies within this distance of the arena's centre, a finger can push it."""
PARKED_RAD = np.array([-0.25, 1.4, -2.5])
"""One finger's joints while another pushes: outside, tip 19 cm above the table."""
HOVER_M = 0.13
BEHIND_M = 0.072
"""From the object's centre to where the tip comes down: behind the largest object's side."""
MAX_TIP_RADIUS_M, MAX_END_RADIUS_M = 0.175, 0.10
_REACH_M = (0.02, 0.05)  # how far the object is pushed if it is as wide as the cube
_SPEED_M_S = (0.1, 0.5)  # of the tip, at most
_PUSH_S = 6.0  # one thrust with everything around it
_MARGIN_RAD = 0.03
_LARGEST_LEAN_M = 0.02  # of the lower link's upper end over its tip, towards the object
_CORRECTION = 0.02  # share of the joints' error that is added to the target with every command: a time constant of 0.5 s
_MAX_CORRECTION_RAD = 0.06


@dataclass(frozen=True)
class Thrust:
    """One push: by which finger, from where along which unit vector, how far and how fast; (3,) and (3,), m, m and m/s."""

    finger: int
    start_m: np.ndarray
    direction: np.ndarray
    length_m: float
    speed_m_s: float


def slide_cube(rng: np.random.Generator) -> Course:
    """Thrusts at drawn speeds, as many as fit: friction of the object on the table, its mass, what the tracker is late by."""
    parked = np.tile(PARKED_RAD, 3)
    sight = yield from follow(glide(c.START_JOINT_POSITION_RAD, parked, 1.5))
    left = commands(DURATION_S - 1.5)
    while left >= commands(_PUSH_S):
        assert sight is not None
        thrust = draw_thrust(rng, sight)
        if thrust is None:
            sight = yield from follow(hold(parked, 0.5))
            left -= commands(0.5)
            continue
        sight = yield from _push(thrust)
        left -= commands(_PUSH_S)
    return (yield from follow(np.repeat(parked[None], left, axis=0)))


def draw_thrust(rng: np.random.Generator, sight: Sight) -> Thrust | None:
    """A thrust that a finger can do and that leaves the object within reach, None if there is none.

    It goes against a side of the object if it can, otherwise in any of 24 directions.
    """
    centre = sight.cube_position_world_m.copy()
    centre[2] = np.clip(centre[2], 0.022, 0.04)
    length, speed = BEHIND_M - c.CUBE_WIDTH_M / 2 - c.TIP_RADIUS_M + rng.uniform(*_REACH_M), rng.uniform(*_SPEED_M_S)
    sides, angles = _side_directions(sight.cube_quat_wxyz), np.arange(24) * np.pi / 12
    others = np.stack([np.cos(angles), np.sin(angles), np.zeros(24)], axis=1)
    for directions in (sides, others):
        found = _possible_thrusts(centre, directions, length, speed)
        if found:
            return found[rng.integers(len(found))]
    return None


def _possible_thrusts(centre: np.ndarray, directions: np.ndarray, length: float, speed: float) -> list[Thrust]:
    found = []
    for direction in directions:
        start = centre - BEHIND_M * direction
        end = centre + (length - BEHIND_M + c.CUBE_WIDTH_M / 2 + c.TIP_RADIUS_M) * direction  # of the object
        if np.hypot(*start[:2]) > MAX_TIP_RADIUS_M or np.hypot(*end[:2]) > max(MAX_END_RADIUS_M, np.hypot(*centre[:2])):
            continue
        for finger in range(3):
            thrust = Thrust(finger, start, direction, length, speed)
            if _is_possible(thrust):
                found.append(thrust)
    return found


def _side_directions(quat_wxyz: np.ndarray) -> np.ndarray:
    """Horizontal unit vectors along the sides of a box that lies flat, shape (4, 3)."""
    w, x, y, z = quat_wxyz
    first = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y + w * z)], [2 * (x * y - w * z), 1 - 2 * (x * x + z * z)]])
    most_level = first[np.argmax(np.linalg.norm(first, axis=1))]
    a, b = most_level / max(np.linalg.norm(most_level), 1e-9)
    return np.array([[a, b, 0.0], [-b, a, 0.0], [-a, -b, 0.0], [b, -a, 0.0]])


def _is_possible(thrust: Thrust) -> bool:
    """Whether the joints stay within their soft limits over the whole way and the lower link leans away from the object."""
    ends = np.stack([thrust.start_m, thrust.start_m + thrust.length_m * thrust.direction])
    way = np.concatenate([ends, ends * [1, 1, 0] + [0, 0, HOVER_M]])
    joints = _finger_joints_rad(thrust.finger, way)
    lower, upper = c.SOFT_LIMIT_LOWER_RAD[:3] + _MARGIN_RAD, c.SOFT_LIMIT_UPPER_RAD[:3] - _MARGIN_RAD
    if not ((joints > lower) & (joints < upper)).all():  # out of reach is NaN, which compares as False
        return False
    elbows = elbow_position_world_m(np.tile(joints, 3))[:, 3 * thrust.finger : 3 * thrust.finger + 3]
    return bool(((elbows - way)[:2] @ thrust.direction < _LARGEST_LEAN_M).all())


def _finger_joints_rad(finger: int, tip_m: np.ndarray) -> np.ndarray:
    """Joints (k, 3) of one finger for its tip at (k, 3)."""
    return joint_position_rad(np.tile(tip_m, 3))[:, 3 * finger : 3 * finger + 3]


def _push(thrust: Thrust) -> Course:
    """Over to behind the object, down, thrust, up and back; takes ``_PUSH_S``."""
    parked_tip = fingertip_position_world_m(np.tile(PARKED_RAD, 3))[3 * thrust.finger : 3 * thrust.finger + 3]
    above, behind = np.array([*thrust.start_m[:2], HOVER_M]), thrust.start_m
    end = behind + thrust.length_m * thrust.direction
    drawn_back = end - 0.01 * thrust.direction
    thrust_s = 1.875 * thrust.length_m / thrust.speed_m_s  # minimal jerk: the highest speed is 1.875 times the mean
    way = [(above, 1.2), (behind, 0.9), (behind, 0.5), (end, thrust_s), (drawn_back, 0.1)]
    way += [(np.array([*drawn_back[:2], HOVER_M]), 0.4), (parked_tip, 1.2)]
    tips, here = [], parked_tip
    for point, seconds in way:
        tips.append(here + eased(seconds)[:, None] * (point - here))
        here = point
    path = np.tile(PARKED_RAD, (commands(_PUSH_S), 3))
    joints = _finger_joints_rad(thrust.finger, np.concatenate(tips))
    path[: len(joints), 3 * thrust.finger : 3 * thrust.finger + 3] = joints
    return _follow_closely(path, thrust.finger)


def _follow_closely(path_rad: np.ndarray, finger: int) -> Course:
    """Follow a path (k, 9) and lead one finger's targets by what it lags behind at rest (gravity, friction)."""
    joints, lead, sight = slice(3 * finger, 3 * finger + 3), np.zeros(3), None
    for target in path_rad:
        wanted = target.copy()
        wanted[joints] += lead
        sight = yield Command(np.zeros((1, 9)), wanted[None]), COMMAND_STEPS
        error = target[joints] - sight.joint_position_rad[joints]
        lead = np.clip(lead + _CORRECTION * error, -_MAX_CORRECTION_RAD, _MAX_CORRECTION_RAD)
    return sight
