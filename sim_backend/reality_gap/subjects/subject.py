"""The seam between recordings and verdicts: what a study works on, and what every subject answers."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from sim_backend.reality_gap.knowledge.known_of_robot import Robot
from sim_backend.reality_gap.measured.foreign.study_file import StudyFile
from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.verdict import Verdict

Progress = Callable[[str, float], None]
"""Told what is done now, and the share that is done, 0 to 1."""
Sections = dict[str, Any]
"""Parts of ``study.json`` beside the verdict, plain values."""
CUBE_EXCITATION = "slide_cube"
"""In it fingers touch the cube, so that nothing is told of joints."""


@dataclass(frozen=True)
class Material:
    """What a study works on.

    Attributes:
        title: of the study.
        recordings: all of them, whatever they show.
        files: that they and their model were read from.
        study_file: that describes them; without one they are a TriFinger's of the farm.
        robot: its name, if it is one of the farm's.
        trials: logs of the farm beside those of excitations, which nothing is judged from.
        method: how joints are fitted: ``naming``, or a calibration that names nothing.
    """

    title: str
    recordings: tuple[Recording, ...]
    files: tuple[Path, ...]
    study_file: StudyFile | None = None
    robot: str | None = None
    trials: tuple[Path, ...] = ()
    method: str = "naming"


class Subject(Protocol):
    """A module that studies one kind of thing."""

    def seen_in(self, material: Material) -> tuple[Recording, ...]:
        """The recordings that it can study; none where there is nothing for it."""
        ...

    def study(self, material: Material, known: Robot, rng: np.random.Generator, progress: Progress) -> tuple[Verdict, Sections]:
        """Replay, residual, fit, verdict and gain of these recordings.

        Raises:
            RecordingError: data that cannot be used; the message says why.
        """
        ...


def part(progress: Progress, begin: float, end: float) -> Progress:
    """Progress of a part that takes its own share, 0 to 1, of the range: there is one counter."""
    return lambda what, share: progress(what, begin + (end - begin) * share)
