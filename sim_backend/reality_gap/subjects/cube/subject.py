"""A cube and its tracker as a subject: pushes that are replayed, and what the tracker reports of them and of a cube at rest."""

import numpy as np

from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger, Robot
from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.subjects.subject import CUBE_EXCITATION, Material, Progress, Sections
from sim_backend.reality_gap.verdict import Verdict


def seen_in(material: Material) -> tuple[Recording, ...]:
    """Recordings of the farm in which a finger moves the cube."""
    return tuple(r for r in material.recordings if r.regime == CUBE_EXCITATION) if material.study_file is None else ()


def study(material: Material, known: Robot, rng: np.random.Generator, progress: Progress) -> tuple[Verdict, Sections]:
    """As of any :class:`Subject`; what was found of the robot's joints goes into the replay of pushes."""
    from sim_backend.reality_gap.subjects.cube.study import study_cube  # with its replay, which most studies do without

    assert isinstance(known, KnownTriFinger), "only the farm records this excitation"
    return study_cube(seen_in(material), rng, progress, robot=known).verdict, {}
