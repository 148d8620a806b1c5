"""From what a robot measures to the vector a policy sees, field by field as its manifest names them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from api_schemas.observation import Term, fields_of, term_of
from sim_backend.driver.driver import Measurement
from sim_backend.driver.tracker import TrackedPose
from sim_backend.tasks.keypoints import cube_keypoints_world_m
from sim_backend.tasks.task import Goal
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m, fingertip_velocity_world_m_s


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
    "fingertip_velocity_world_m_s": lambda s: fingertip_velocity_world_m_s(
        s.measurement.joint_position_rad, s.measurement.joint_velocity_rad_s
    ),
    "fingertip_force": lambda s: felt(s.measurement),
    "cube_quat_xyzw": lambda s: s.tracked.cube_quat_wxyz[:, [1, 2, 3, 0]],
    "goal_quat_xyzw": lambda s: s.goal.cube_quat_wxyz[:, [1, 2, 3, 0]],
    "robot_id": lambda s: np.full((len(s.step), 1), float(c.SIMULATED_ROBOT_ID)),
}
"""Each gives shape (n, size); names and sizes are those of ``api_schemas.observation.OBSERVATION_SIZES``."""

CHANGES_WITH_TRACKER = frozenset(
    {"cube_position_world_m", "cube_quat_wxyz", "cube_quat_xyzw", "cube_keypoints_world_m", "tracker_confidence"}
)
CONSTANT_IN_A_TRIAL = frozenset(
    {"goal_position_world_m", "goal_quat_wxyz", "goal_quat_xyzw", "goal_keypoints_world_m", "goal_fingertip_position_world_m"}
)
FELT = "fingertip_force"
"""The one field that the driver measures only where it is asked for."""


def felt(measurement: Measurement) -> np.ndarray:
    """Readings of the fingertips' force sensors, shape (n, 3).

    Raises:
        ValueError: the driver was not asked for them.
    """
    if measurement.fingertip_force is None:
        raise ValueError(f"{FELT} is measured only for manifests that name it")
    return measurement.fingertip_force


class ObservationBuilder:
    """Builds observation vectors; recomputes a field only when what it is made of has changed.

    Owner of earlier values, for terms that show them; it is asked once in each control period.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._terms = [term_of(name) for name in names]
        self._fields = fields_of(names)
        self._changing = frozenset(self._fields) - CONSTANT_IN_A_TRIAL - CHANGES_WITH_TRACKER
        self._parts: dict[str, np.ndarray] = {}
        self._tracked: TrackedPose | None = None
        self._goal: Goal | None = None
        late = [(term.field, max(term.periods_ago)) for term in self._terms if term.field is not None and max(term.periods_ago)]
        self._past = {name: Past(max(ago for other, ago in late if other == name)) for name, _ in late}

    @property
    def feels(self) -> bool:
        """Whether the driver is to measure the fingertips' forces."""
        return FELT in self._fields

    def build(self, sight: Sight) -> np.ndarray:
        """The observation, shape (n, size), float64."""
        stale = self._changing
        if sight.tracked is not self._tracked:
            stale = stale | CHANGES_WITH_TRACKER
        if sight.goal is not self._goal:
            stale = stale | CONSTANT_IN_A_TRIAL
        parts = self._parts
        for name in self._fields:
            if name in stale or name not in parts:
                parts[name] = FIELDS[name](sight)
        self._tracked, self._goal = sight.tracked, sight.goal
        for name, past in self._past.items():
            past.keep(parts[name], sight.step)
        return np.concatenate([self._shown(term, len(sight.step)) for term in self._terms], axis=1)

    def _shown(self, term: Term, robots: int) -> np.ndarray:
        if term.field is None:
            return np.tile(term.constant, (robots, 1))
        if term.is_whole:
            return self._parts[term.field]
        columns = slice(term.numbers.start, term.numbers.stop)
        if term.field not in self._past:
            return self._parts[term.field][:, columns]
        values = self._past[term.field].values
        return np.concatenate([values[:, ago, columns] for ago in term.periods_ago], axis=1)


class Past:
    """A field's values in the last periods of each robot's trial; ``values`` is (n, periods + 1, size), the newest first."""

    def __init__(self, periods: int) -> None:
        self._periods = periods
        self.values, self._step = np.zeros((0, 0, 0)), np.zeros(0)

    def keep(self, value: np.ndarray, step: np.ndarray) -> None:
        """Take what is seen now, shape (n, size), at the step (n,) of each robot's trial; looking twice changes nothing."""
        begun = np.ones(len(value), dtype=bool) if len(self.values) != len(value) else step == 0
        if len(self.values) != len(value):
            self.values = np.repeat(value[:, None], self._periods + 1, axis=1)
        else:
            moved = step != self._step
            self.values[moved, 1:] = self.values[moved, :-1]
            self.values[:, 0] = value
        self.values[begun] = value[begun][:, None]
        self._step = step.copy()
