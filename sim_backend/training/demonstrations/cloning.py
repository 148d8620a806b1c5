"""Samples from recorded demonstrations, for a student that only imitates them."""

import numpy as np
import torch

from api_schemas.observation import sizes_of
from api_schemas.policy import PolicyManifest
from sim_backend.environments.practice import Practice
from sim_backend.training.demonstrations.recipe import ImitationTable
from sim_backend.training.demonstrations.recording import Demonstrations, joined, read_demonstrations
from sim_backend.training.demonstrations.samples import Samples
from sim_backend.training.demonstrations.student import Student
from sim_backend.training.demonstrations.teacher import check_same_actions

__all__ = ["Cloning", "read_demonstrations"]


class Cloning:
    """Hands out what was recorded; nobody acts. Owner of the samples.

    Raises:
        ValueError: they lack what the recipe's layout shows, or have other actions.
    """

    def __init__(self, recorded: list[Demonstrations], practice: Practice, settings: ImitationTable, student: Student) -> None:
        found = joined(recorded)
        seen, wanted = as_practised(found, practice)
        self._seen, self._drawn = torch.from_numpy(seen), settings.updates * settings.batch
        self.successes: list[bool] = []
        self.teacher_successes: list[bool] = []
        ends = [*found.first[1:], len(seen)]
        windows = [
            np.arange(start, start + settings.window)
            for first, end in zip(found.first, ends, strict=True)
            for start in range(first, end - settings.window + 1, settings.window)
        ]
        if not windows:
            raise ValueError(f"no trial is as long as the window of {settings.window} control periods; make it shorter")
        rows = np.stack(windows, axis=1)
        self.samples = Samples(rows.shape[1], settings.window, seen.shape[1], student.parts, student.cells)
        state = student.nothing(rows.shape[1])
        self.samples.add(self._seen[rows], torch.from_numpy(wanted)[rows], state)

    def advance(self, _student: Student, _done: float) -> torch.Tensor:
        """Nobody acts; returns a part of what was recorded, as large as what the updates draw, shape (samples, size)."""
        return self._seen[torch.randint(len(self._seen), (self._drawn,))]


def as_practised(found: Demonstrations, practice: Practice) -> tuple[np.ndarray, np.ndarray]:
    """Observations (samples, size) as the practised layout has them, and actions (samples, 9) in units of the largest.

    Raises:
        ValueError: the layout has a field that was not recorded, or the actions are of another kind.
    """
    check_same_actions(found.manifest, practice.manifest)
    columns = _columns(found.manifest)
    missing = [name for name in practice.manifest.observation if name not in columns]
    if missing:
        raise ValueError(
            f"the demonstrations have no {', '.join(missing)}; choose a layout of {', '.join(found.manifest.observation)}"
        )
    chosen = np.concatenate([columns[name] for name in practice.manifest.observation])
    space = practice.action_space
    wanted = np.clip((found.action - space.middle) / space.largest, -1.0, 1.0)
    return found.observation[:, chosen].astype(np.float32), wanted.astype(np.float32)


def _columns(manifest: PolicyManifest) -> dict[str, np.ndarray]:
    """Where each field lies in an observation."""
    columns, first = {}, 0
    for name, size in zip(manifest.observation, sizes_of(manifest.observation), strict=True):
        columns[name] = np.arange(first, first + size)
        first += size
    return columns
