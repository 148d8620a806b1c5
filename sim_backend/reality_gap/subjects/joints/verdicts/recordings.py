"""Recordings by themselves: in which of them a model goes where the robot went, with the causes that were found and without."""

import numpy as np

from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_trials import settled
from sim_backend.reality_gap.subjects.joints.verdicts.wording import listed

_LEAST = 5
"""Windows of a recording that is looked at by itself."""
_CLEARLY = 2.0
"""Times as far off as without causes, where they are not there."""
_MOST_TOLD = 5


class Recordings:
    """A study's recordings that have enough windows, each with a model that is fitted to it within the model's tolerances.

    Args:
        study: of the recordings.
        selection: causes and models.
        healthy_rad: what usual windows of a healthy robot may be off, shape (k,).
    """

    def __init__(self, study: JointStudy, selection: RolloutSelection, healthy_rad: np.ndarray) -> None:
        self._study, self._selection, self._healthy_rad = study, selection, healthy_rad
        owners = selection.problem.windows.owner
        rows = {owner: np.flatnonzero(owners == owner) for owner in range(len(study.problem.episodes))}
        self._rows = {owner: of_it for owner, of_it in rows.items() if len(of_it) >= _LEAST}
        self._without = dict[int, np.ndarray]()

    def contradict(self, limit_rad: np.ndarray) -> bool:
        """Whether in some recording the model without causes goes where the robot went, and with them clearly does not.

        Args:
            limit_rad: what usual windows may be off with the causes, shape (k,).
        """
        fit = self._selection.fit
        for owner, rows in self._rows.items():
            is_near = bool((np.sqrt(np.median(fit.squares[rows], axis=0)) <= limit_rad).all())
            if is_near or not self._goes_without(owner):
                continue
            with_rad = self._fitted_rad(owner, fit.state)
            if bool((with_rad > np.maximum(limit_rad, _CLEARLY * self._without_rad(owner))).any()):
                return True
        return False

    def apart(self) -> list[str]:
        """What is another in some recordings, where in others the model without causes goes where the robot went."""
        right, wrong = list[str](), list[str]()
        for owner in self._rows:
            name = self._study.problem.episodes[owner].path.recording.name
            (right if self._goes_without(owner) else wrong).append(name)
        if not (right and wrong):
            return []
        others, those = (f"{listed(each[:_MOST_TOLD])}{' and others' if each[_MOST_TOLD:] else ''}" for each in (wrong, right))
        return [f"what is another in {others}, such as a load or the rig: in {those} the model goes where the robot went"]

    def _goes_without(self, owner: int) -> bool:
        return bool((self._without_rad(owner) <= self._healthy_rad).all())

    def _without_rad(self, owner: int) -> np.ndarray:
        if owner not in self._without:
            self._without[owner] = self._fitted_rad(owner, self._selection.problem.start)
        return self._without[owner]

    def _fitted_rad(self, owner: int, state: JointState) -> np.ndarray:
        """What usual windows of a recording are off, shape (k,), with a model that goes on from a state."""
        alone = self._selection.problem.part(self._rows[owner])
        return settled(alone, alone.fitted(state, ())).usual_rad
