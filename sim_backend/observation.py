"""From what a robot measures to the vector a policy sees, field by field as its manifest names them."""

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np

from api_schemas.observation import Term, fields_of, sizes_of, term_of
from sim_backend.driver.driver import Measurement
from sim_backend.driver.tracker import TrackedPose
from sim_backend.tasks.keypoints import cube_keypoints_world_m
from sim_backend.tasks.task import Goal
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.kinematics import fingertip_position_world_m, fingertip_velocity_world_m_s


class Sight(NamedTuple):
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
        terms = [term_of(name) for name in names]
        self._fields = fields_of(names)
        late = [(term.field, max(term.periods_ago)) for term in terms if term.field is not None and max(term.periods_ago)]
        self._past = {name: Past(max(ago for other, ago in late if other == name)) for name, _ in late}
        ends = np.cumsum(sizes_of(names)).tolist()
        places = list(zip(terms, map(slice, [0, *ends[:-1]], ends), strict=True))
        self._size = ends[-1]
        self._of_tracker = self._of(places, CHANGES_WITH_TRACKER)
        self._constant = self._of(places, CONSTANT_IN_A_TRIAL | {None})
        self._changing = self._of(places, frozenset(FIELDS) - CHANGES_WITH_TRACKER - CONSTANT_IN_A_TRIAL)
        self._built = np.empty((0, self._size))
        self._tracked: TrackedPose | None = None
        self._goal: Goal | None = None

    @property
    def feels(self) -> bool:
        """Whether the driver is to measure the fingertips' forces."""
        return FELT in self._fields

    def build(self, sight: Sight) -> np.ndarray:
        """The observation, shape (n, size), float64."""
        if len(self._built) != len(sight.previous_action):
            self._built = np.empty((len(sight.previous_action), self._size))
            self._tracked = self._goal = None
        built = self._built
        for name, past in self._past.items():
            past.keep(FIELDS[name](sight), sight.step)
        for value, place in self._changing:
            built[:, place] = value(sight)
        if sight.tracked is not self._tracked or self._past:
            for value, place in self._of_tracker:
                built[:, place] = value(sight)
        if sight.goal is not self._goal or self._past:
            for value, place in self._constant:
                built[:, place] = value(sight)
        self._tracked, self._goal = sight.tracked, sight.goal
        return built.copy()

    def _of(
        self, places: list[tuple[Term, slice]], fields: Collection[str | None]
    ) -> list[tuple[Callable[[Sight], np.ndarray], slice]]:
        """Those of the terms that show these fields, each as a function with its place in the vector."""
        return [(self._shown(term), place) for term, place in places if term.field in fields]

    def _shown(self, term: Term) -> Callable[[Sight], np.ndarray]:
        if term.field is None:
            return lambda _: np.array(term.constant)
        field, columns = FIELDS[term.field], slice(term.numbers.start, term.numbers.stop)
        if term.is_whole:
            return field
        if max(term.periods_ago) == 0:
            return lambda sight: np.concatenate([field(sight)[:, columns] for _ in term.periods_ago], axis=1)
        past = self._past[term.field]
        return lambda _: np.concatenate([past.values[:, ago, columns] for ago in term.periods_ago], axis=1)


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
