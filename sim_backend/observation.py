"""From what a robot measures to the vector a policy sees, field by field as its manifest names them."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from api_schemas.policy import OBSERVATION_SIZES
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
        ends = np.cumsum([OBSERVATION_SIZES[name] for name in names]).tolist()
        places = dict(zip(names, map(slice, [0, *ends[:-1]], ends), strict=True))
        self._size = ends[-1]
        of_tracker, constant = (_of(places, some) for some in (CHANGES_WITH_TRACKER, CONSTANT_IN_A_TRIAL))
        self._of_tracker, self._constant = of_tracker, constant
        self._changing = _of(places, places.keys() - CHANGES_WITH_TRACKER - CONSTANT_IN_A_TRIAL)
        self._built = np.empty((0, self._size))
        self._tracked: TrackedPose | None = None
        self._goal: Goal | None = None

    def build(self, sight: Sight) -> np.ndarray:
        """The observation, shape (n, size), float64."""
        if len(self._built) != len(sight.previous_action):
            self._built = np.empty((len(sight.previous_action), self._size))
            self._tracked = self._goal = None
        built = self._built
        for field, place in self._changing:
            built[:, place] = field(sight)
        if sight.tracked is not self._tracked:
            for field, place in self._of_tracker:
                built[:, place] = field(sight)
        if sight.goal is not self._goal:
            for field, place in self._constant:
                built[:, place] = field(sight)
        self._tracked, self._goal = sight.tracked, sight.goal
        return built.copy()


def _of(places: dict[str, slice], names: Collection[str]) -> list[tuple[Callable[[Sight], np.ndarray], slice]]:
    """Those of the fields that have these names, each with its place in the vector."""
    return [(FIELDS[name], place) for name, place in places.items() if name in names]
