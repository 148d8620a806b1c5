"""Brings an object back from the wall: one finger reaches behind it and draws it towards the centre of the arena.

The tip goes over the object, down between object and wall, where the wall's slope guides it, and inwards. Everything it knows of
the object is where the tracker saw it.
"""

from dataclasses import dataclass

import numpy as np

from robot_farm.arena.finger_reach import reach
from robot_farm.arena.motion import RAISED_RAD, START_RAD, Motion
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import Shape

REACH_M = c.MAX_CUBE_CENTRE_DISTANCE_M
"""An object whose centre is farther from the arena's is out of reach: no goal and no start of a task lies there."""
DRAWN_TO_M = (0.03, 0.08)
"""The centre of the object ends up between so near and so far from the arena's; drawn, so that starts differ."""
_BEHIND_RADIUS_M = 0.2035  # the tip touches the wall at the height of a cube's upper edge
_RAISE_RAD = 0.5
ASIDE_RAD = RAISED_RAD + np.tile([0.3, 0.0, 0.0], 3)
"""Raised and turned to the side, so that each joint is at least 0.3 rad from the start pose."""


@dataclass(frozen=True)
class Waypoint:
    """Where a tip shall be: distance from the arena's centre and height, m, and how long it takes to get there, s."""

    radius_m: float
    height_m: float
    duration_s: float


@dataclass(frozen=True)
class SweepPlan:
    """Which finger sweeps, in which direction from the centre, and through which points."""

    finger: int
    azimuth_rad: float
    waypoints: tuple[Waypoint, ...]

    def tip_world_m(self, radius_m: float, height_m: float) -> np.ndarray:
        """A point of the sweep's vertical plane, shape (3,)."""
        return np.array([radius_m * np.cos(self.azimuth_rad), radius_m * np.sin(self.azimuth_rad), height_m])


def plan_sweep(object_position_world_m: np.ndarray, shape: Shape, drawn_to_m: float) -> SweepPlan:
    """The sweep of the finger that reaches best behind an object.

    Args:
        object_position_world_m: where the tracker saw it, shape (3,).
        shape: the object.
        drawn_to_m: distance from the arena's centre to which its centre shall be drawn.
    """
    top_m = 2 * shape.rest_height_m
    inner_m = drawn_to_m + max(shape.size_m[:2]) / 2 + c.TIP_RADIUS_M
    waypoints = (
        Waypoint(0.15, top_m + 0.035, 0.5),
        Waypoint(0.195, top_m + 0.023, 0.4),
        Waypoint(_BEHIND_RADIUS_M, top_m + 0.001, 0.3),
        Waypoint(0.196, 0.65 * top_m, 0.4),
        Waypoint(inner_m, 0.62 * top_m, 1.2),
        Waypoint(inner_m + 0.025, top_m, 0.2),
        Waypoint(inner_m + 0.03, top_m + 0.035, 0.2),
    )
    azimuth_rad = float(np.arctan2(object_position_world_m[1], object_position_world_m[0]))
    plans = [SweepPlan(finger, azimuth_rad, waypoints) for finger in range(3)]
    return min(plans, key=_out_of_the_way_m)


def sweep(motion: Motion, plan: SweepPlan) -> np.ndarray:
    """Sweep, and bring the fingers into their start pose.

    Returns:
        As :func:`retreat`.
    """
    motion.go_to(RAISED_RAD, 0.5)
    first, pose_rad = plan.waypoints[0], RAISED_RAD.copy()
    _place_tip(pose_rad, plan, first.radius_m, first.height_m)
    motion.go_to(pose_rad, first.duration_s)
    for before, after in zip(plan.waypoints, plan.waypoints[1:], strict=False):
        motion.follow(lambda share, a=before, b=after: _tip_between(pose_rad, plan, a, b, share), after.duration_s)
    return retreat(motion)


def retreat(motion: Motion) -> np.ndarray:
    """Raise all fingers outwards and bring them into the start pose from above, by way of a pose in which no joint is near it.

    Returns:
        How far each joint was from where it should be, in that pose or in the start pose, whichever is more; shape (9,), rad. A
        joint that is stuck near one of the two is not near the other.
    """
    pose_rad = motion.joint_position_rad.copy()
    pose_rad[1::3] = np.minimum(pose_rad[1::3] + _RAISE_RAD, c.SOFT_LIMIT_UPPER_RAD[1::3] - 0.07)
    motion.go_to(pose_rad, 0.3)
    motion.go_to(RAISED_RAD, 0.5)
    motion.go_to(ASIDE_RAD, 0.3)
    aside_rad = motion.hold(ASIDE_RAD, 0.2)
    motion.go_to(RAISED_RAD, 0.3)
    motion.go_to(START_RAD, 0.4)
    start_rad = motion.hold(START_RAD, 0.4)
    return np.where(np.abs(aside_rad) > np.abs(start_rad), aside_rad, start_rad)


def _tip_between(pose_rad: np.ndarray, plan: SweepPlan, before: Waypoint, after: Waypoint, share: float) -> np.ndarray:
    """The pose at a share of the way between two waypoints; the last one that was found where nothing can be reached."""
    radius_m = before.radius_m + share * (after.radius_m - before.radius_m)
    _place_tip(pose_rad, plan, radius_m, before.height_m + share * (after.height_m - before.height_m))
    return pose_rad


def _place_tip(pose_rad: np.ndarray, plan: SweepPlan, radius_m: float, height_m: float) -> None:
    joints_rad, _ = reach(plan.finger, plan.tip_world_m(radius_m, height_m))
    if joints_rad is not None:
        pose_rad[3 * plan.finger : 3 * plan.finger + 3] = joints_rad


def _out_of_the_way_m(plan: SweepPlan) -> float:
    """How far the plan's waypoints have to be moved so that its finger reaches them."""
    return sum(reach(plan.finger, plan.tip_world_m(w.radius_m, w.height_m))[1] for w in plan.waypoints)
