"""Compares what a log holds with what a new simulation gave, number by number."""

from dataclasses import dataclass, field

import numpy as np

from api_schemas.scene_form import form_or_first
from api_schemas.tracker import TrackerName
from sim_backend.trifinger.form import scene_form
from sim_backend.trifinger.objects import Shape, shape_of
from trial_logs.reader import LogUnreadableError, TrialLog

LARGEST = float(np.finfo(float).max)
"""The difference from no number at all: JSON has no infinity."""


class NotRepeatableError(Exception):
    """The farm's own files of a trial cannot be simulated again; says nothing about a log that is compared with them."""


@dataclass(frozen=True)
class Verification:
    """What a replay found. ``first_difference_step`` is the first step whose numbers differ, None if there is none.

    ``form`` is the scene's form that the log is of, ``simulated_form`` the one that it was simulated with.
    """

    trial_id: str
    steps: int
    same: bool
    first_difference_step: int | None
    largest_joint_difference_rad: float
    largest_cube_difference_m: float
    form: str
    simulated_form: str


@dataclass
class Comparison:
    """What differs: the first step where anything does, and by how much at most for each sort of number that is named."""

    first_step: int | None = None
    largest: dict[str, float] = field(default_factory=dict)

    def compare(self, steps: np.ndarray, logged: np.ndarray, simulated: np.ndarray, name: str = "") -> None:
        """Compare rows.

        Args:
            steps: of each row, shape (n,).
            logged: shape (n, ...).
            simulated: shape (n, ...); fewer or more rows differ from the first that is missing.
            name: sort of number whose largest difference is wanted.
        """
        alike = logged.shape[1:] == simulated.shape[1:]
        common = min(len(logged), len(simulated)) if alike else 0
        differs = _differing(logged[:common], simulated[:common]) if common else np.empty(0, int)
        if len(differs):
            self.note(int(steps[differs[0]]))
        elif len(logged) != len(simulated) or (len(logged) and not alike):
            self.note(int(steps[common]) if common < len(steps) else int(steps[-1]) if len(steps) else 0)
        if name and common:
            largest = np.nan_to_num(np.abs(logged[:common] - simulated[:common]).max(), nan=LARGEST)
            self.largest[name] = max(self.largest.get(name, 0.0), float(largest))

    def note(self, step: int) -> None:
        """Something differs at this step."""
        self.first_step = step if self.first_step is None else min(self.first_step, step)


def _differing(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The rows in which anything differs; NaN equals NaN."""
    differs = (one != other) & ~(np.isnan(one) & np.isnan(other))
    return np.flatnonzero(differs.any(axis=tuple(range(1, differs.ndim))))


def check_complete(log: TrialLog) -> None:
    """Refuse a log with gaps, and one whose tracker looked at images: replays have the formula.

    Raises:
        LogUnreadableError: it does not have one joint state and one torque for every millisecond, or its tracker is no formula.
    """
    if log.outcome.get("tracker", TrackerName.POSE) != TrackerName.POSE:
        raise LogUnreadableError("the trial's tracker looked at images; a replay has the formula in its place, and tells nothing")
    steps = len(log.joint_steps)
    if steps == 0 or len(log.applied_torque_nm) != steps or (log.joint_steps != np.arange(steps)).any():
        raise LogUnreadableError("the log does not have one joint state and one torque for every millisecond from the start")


def shape_of_log(log: TrialLog) -> Shape:
    """The object in the arena; logs from before there was a choice are of the cube.

    Raises:
        LogUnreadableError: the log names an object that does not exist.
    """
    try:
        return shape_of(log.metadata.get("object", "cube"), float(log.metadata.get("object_scale", 1.0)))
    except ValueError as error:
        raise LogUnreadableError(f"the log is of no object of the farm: {error}") from error


def verification(log: TrialLog, driving: TrialLog, found: Comparison) -> Verification:
    """What was found about a log when the trial that ``driving`` tells of was simulated again."""
    return Verification(
        trial_id=log.metadata.get("trial_id", ""),
        steps=len(log.joint_steps),
        same=found.first_step is None,
        first_difference_step=found.first_step,
        largest_joint_difference_rad=found.largest.get("joint", 0.0),
        largest_cube_difference_m=found.largest.get("cube", 0.0),
        form=form_or_first(driving.metadata.get("form")),
        simulated_form=scene_form(),
    )
