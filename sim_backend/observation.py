"""From what a robot measures to the vector a policy sees, field by field as its manifest names them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.driver.driver import Measurement
from sim_backend.driver.tracker import TrackedPose
from sim_backend.tasks.keypoints import cube_keypoints_world_m
from sim_backend.tasks.task import Goal
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m


@dataclass(frozen=True)
class Sight:
    """Everything a field may be made of, for n robots at one instant.

    ``step`` counts physics steps since the begin of each robot's trial, shape (n,); ``previous_action`` has shape (n, 9).
    """

    step: np.ndarray
    measurement: Measurement
    tracked: TrackedPose
    goal: Goal
    previous_action: np.ndarray
    physics_step_s: float = c.PHYSICS_STEP_S


FIELDS: dict[str, Callable[[Sight], np.ndarray]] = {
    "joint_position_rad": lambda s: s.measurement.joint_position_rad,
    "joint_velocity_rad_s": lambda s: s.measurement.joint_velocity_rad_s,
    "joint_torque_nm": lambda s: s.measurement.joint_torque_nm,
    "fingertip_position_world_m": lambda s: fingertip_position_world_m(s.measurement.joint_position_rad),
    "cube_position_world_m": lambda s: s.tracked.cube_position_world_m,
    "cube_quat_wxyz": lambda s: s.tracked.cube_quat_wxyz,
    "cube_keypoints_world_m": lambda s: cube_keypoints_world_m(s.tracked.cube_position_world_m, s.tracked.cube_quat_wxyz),
    "tracker_confidence": lambda s: s.tracked.confidence[:, None],
    "tracker_delay_s": lambda s: (s.step - s.tracked.capture_step)[:, None] * s.physics_step_s,
    "goal_position_world_m": lambda s: s.goal.cube_position_world_m,
    "goal_quat_wxyz": lambda s: s.goal.cube_quat_wxyz,
    "goal_keypoints_world_m": lambda s: cube_keypoints_world_m(s.goal.cube_position_world_m, s.goal.cube_quat_wxyz),
    "goal_fingertip_position_world_m": lambda s: s.goal.fingertip_position_world_m,
    "previous_action": lambda s: s.previous_action,
}
"""Each gives shape (n, size); names and sizes are those of ``api_schemas.policy.OBSERVATION_SIZES``."""

CHANGES_WITH_TRACKER = frozenset({"cube_position_world_m", "cube_quat_wxyz", "cube_keypoints_world_m", "tracker_confidence"})
CONSTANT_IN_A_TRIAL = frozenset(
    {"goal_position_world_m", "goal_quat_wxyz", "goal_keypoints_world_m", "goal_fingertip_position_world_m"}
)


class ObservationBuilder:
    """Builds observation vectors; recomputes a field only when what it is made of has changed."""

    def __init__(self, names: Sequence[str]) -> None:
        unknown = [name for name in names if name not in FIELDS]
        if unknown:
            raise ValueError(f"unknown observation fields {unknown}; choose from {', '.join(FIELDS)}")
        self._names = tuple(names)
        self._changing = frozenset(self._names) - CONSTANT_IN_A_TRIAL - CHANGES_WITH_TRACKER
        self._parts: dict[str, np.ndarray] = {}
        self._tracked: TrackedPose | None = None
        self._goal: Goal | None = None

    def build(self, sight: Sight) -> np.ndarray:
        """The observation, shape (n, size), float64."""
        stale = self._changing
        if sight.tracked is not self._tracked:
            stale = stale | CHANGES_WITH_TRACKER
        if sight.goal is not self._goal:
            stale = stale | CONSTANT_IN_A_TRIAL
        parts = self._parts
        for name in self._names:
            if name in stale or name not in parts:
                parts[name] = FIELDS[name](sight)
        self._tracked, self._goal = sight.tracked, sight.goal
        return np.concatenate([parts[name] for name in self._names], axis=1)
