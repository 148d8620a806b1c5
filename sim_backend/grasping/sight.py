"""What the controller sees: one observation by its fields, and a cube that lies still in several."""

from dataclasses import dataclass, replace

import numpy as np

from api_schemas.observation import sizes_of
from api_schemas.policy import PolicyManifest
from sim_backend.grasping.choice import side_normals
from sim_backend.grasping.turning import wrapped, yaw_between_rad
from sim_backend.tasks.keypoints import rotation_matrix
from sim_backend.trifinger.kinematics import fingertip_position_world_m

REPORTS = 3
"""Of a cube that lies still, before a grasp is chosen."""
STILL_M = 0.015


@dataclass(frozen=True)
class Sight:
    """One observation by its fields; no ``goal_quat_wxyz`` where nothing is to be turned."""

    joint_position_rad: np.ndarray
    cube_position_world_m: np.ndarray
    cube_quat_wxyz: np.ndarray
    tracker_delay_s: float
    goal_position_world_m: np.ndarray
    goal_quat_wxyz: np.ndarray | None = None

    @classmethod
    def of(cls, observation: np.ndarray, manifest: PolicyManifest) -> "Sight":
        """From a row as a built-in policy's manifest has it."""
        ends = np.cumsum(sizes_of(manifest.observation))[:-1]
        joints, cube, quat, delay, *goal = np.split(np.asarray(observation, dtype=float), ends)
        return cls(joints, cube, quat, float(delay[0]), *goal)

    @property
    def tip_m(self) -> np.ndarray:
        """Where the tips are by the measured joints, shape (3, 3)."""
        return fingertip_position_world_m(self.joint_position_rad).reshape(3, 3)

    @property
    def turn_rad(self) -> float:
        """How far the cube is yet to be turned about the vertical."""
        return 0.0 if self.goal_quat_wxyz is None else yaw_between_rad(self.cube_quat_wxyz, self.goal_quat_wxyz)

    def turn_to_goal_of(self, other: "Sight") -> float:
        """How much further than for its own goal the cube is to be turned for another one's."""
        return other.turn_rad - replace(self, cube_quat_wxyz=other.cube_quat_wxyz).turn_rad

    def has_goal_of(self, other: "Sight") -> bool:
        """Whether it asks for the same."""
        if not np.array_equal(self.goal_position_world_m, other.goal_position_world_m):
            return False
        mine, its = self.goal_quat_wxyz, other.goal_quat_wxyz
        return mine is None or its is None or np.array_equal(mine, its)


@dataclass(frozen=True)
class AtRest:
    """A cube that lies still: its centre (3,), m, the normals of its upright faces (4, 3), how far it is to be turned, rad."""

    cube_m: np.ndarray
    normals: np.ndarray
    turn_rad: float


class Reports:
    """The latest reports of the cube, each with the angle of its first upright face. Their owner."""

    def __init__(self) -> None:
        self._kept: list[tuple[Sight, float]] = []

    def at_rest(self, sight: Sight) -> AtRest | None:
        """The cube by the latest reports, of which this is the last; None if it is not still."""
        normals = side_normals(rotation_matrix(sight.cube_quat_wxyz))
        if normals is None:
            self._kept = []
            return None
        angle = 4 * np.arctan2(normals[0, 1], normals[0, 0])  # times four, since the faces of a cube are alike
        self._kept = [*self._kept, (sight, angle)][-REPORTS:]
        places = np.array([each.cube_position_world_m for each, _ in self._kept])
        if len(places) < REPORTS or np.ptp(places, axis=0).max() > STILL_M:
            return None
        angles = np.array([angle for _, angle in self._kept])
        angle = np.arctan2(np.sin(angles).mean(), np.cos(angles).mean()) / 4 + np.arange(4) * np.pi / 2
        normals = np.stack([np.cos(angle), np.sin(angle), np.zeros(4)], axis=1)
        turns = sight.turn_rad + np.array([wrapped(each.turn_rad - sight.turn_rad) for each, _ in self._kept])
        return AtRest(np.median(places, axis=0), normals, wrapped(np.median(turns)))
