"""What a robot that nothing is wrong with may be off by in rollouts, with the standard deviation of each number."""

from collections.abc import Sequence

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import NUMBERS
from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance
from sim_backend.reality_gap.knowledge.unnamed_laws import CREEP, GIVE, ZERO
from sim_backend.reality_gap.subjects.joints.laws.hypotheses import Catalogue, links_off, own_share
from sim_backend.reality_gap.subjects.joints.laws.plant import ARM_M
from sim_backend.reality_gap.subjects.joints.laws.state import CLOCK, JointState, Term
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations

_CLOCK_SHARE = 0.25
"""Standard deviation of when a recorded torque acts, of a row: at most half a row earlier or later."""
_ROLLS_M = 0.02
"""Radius of what a slide rolls on."""
_PROBE_SHARE = 0.4
"""Of a bearing's standard deviation: with less the image of one that is rigid shows a part of the steps only."""


def tolerated(
    episodes: Sequence[EpisodeEquations], start: JointState, catalogue: Catalogue, tolerance: Tolerance
) -> list[tuple[Term, float]]:
    """When recorded torques act, their zeros, where masses lie, what bearings do, and what the model says of all these.

    Args:
        episodes: of the study.
        start: the nominal model.
        catalogue: what may be wrong.
        tolerance: by how much a robot may differ from its model.
    """
    row_s = float(np.median([e.path.step_s for e in episodes]))
    clock = (Term(CLOCK, 0, 0.1 * row_s), _CLOCK_SHARE * row_s)
    links = links_off(tolerance, episodes[0].plant.centre_distance_m)
    own = _of_model(tolerance, catalogue, start)
    return [clock, *_zeros(episodes, tolerance), *links, *own, *_bearings(episodes, tolerance)]


def _zeros(episodes: Sequence[EpisodeEquations], declared: Tolerance) -> list[tuple[Term, float]]:
    """Zeros of torques that were recorded, each with its standard deviation; what a stated controller sends is known."""
    recorded = [
        [np.nan if name in e.path.joints.not_recorded else np.nanmax(np.abs(torque), initial=0.0) for name, torque in each]
        for e in episodes
        for each in [zip(e.path.joints.names, e.acting_nm, strict=True)]
    ]
    scales = 0.5 * declared.zero * np.nan_to_num(np.max(recorded, axis=0))
    return [(Term(ZERO, j, max(float(scale), 1e-9)), float(scale)) for j, scale in enumerate(scales)]


def _bearings(episodes: Sequence[EpisodeEquations], declared: Tolerance) -> list[tuple[Term, float]]:
    """How far bearings give and how fast they creep, each with its standard deviation; of slides those that they roll on."""
    sizes = [_ROLLS_M / ARM_M if is_slide else 1.0 for is_slide in episodes[0].plant.is_slide]
    usual = (GIVE, 0.5 * declared.give_rad), (CREEP, 0.5 * declared.creep_rad_s)
    scales = [(key, j, size * scale) for key, scale in usual for j, size in enumerate(sizes)]
    return [(Term(key, j, _PROBE_SHARE * scale), scale) for key, j, scale in scales]


def _of_model(tolerance: Tolerance, catalogue: Catalogue, start: JointState) -> list[tuple[Term, float]]:
    """What the model itself says of its links, rotors and bearings, each with the standard deviation of what it may be off by."""
    first = {(term.key, term.index): term for term in reversed(catalogue.terms) if term.key in NUMBERS}
    return [(term, own_share(tolerance, key, index, start)) for (key, index), term in first.items()]
