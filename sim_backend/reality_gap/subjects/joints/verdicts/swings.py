"""What the period of a swing does not tell apart: a spring and less inertia, gravity and the pace of the clock.

A swing of one frequency has accelerations that are its positions times a constant. Whether more torque draws a pendulum back or
less of it has to be moved, its period alone does not say. And where nothing drives any joint, a clock that lets s seconds pass
for each told one makes gravity s squared of what it is, exactly and at every joint.
"""

from collections.abc import Sequence

import numpy as np

from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.verdicts.readings import rms_left
from sim_backend.reality_gap.verdict import AXES, Cause, Doubt

_SPRING = ("joint_stiffness", "stiffness_nm_rad")
_ALIKE = 1.0 / 3.0
"""Of a spring's torque inertia, friction and a constant leave less where a joint swings at one pace."""
_BLURRED_RAD_S = 0.02
_SAME_WAY = 0.99
"""Cosine of the angle between nominal and fitted gravity, beyond which a base is tilted and no clock is wrong."""


def perhaps_less_inertia(study: JointStudy, causes: Sequence[Cause]) -> list[Doubt]:
    """Of each spring that draws a joint back: that the joint has less inertia, where its motion does not tell them apart."""
    doubts = []
    for cause in causes:
        if (cause.effect, cause.parameter) != _SPRING or cause.value <= 0.0:
            continue
        share = cause.value * _inertia_of_spring(study.problem.episodes, study.problem.names.index(cause.where))
        if 0.0 < share < 1.0:
            other = (
                f"the model has too much inertia at {cause.where}, {share:.0%} of it: at one pace of swinging both are the same"
            )
            doubts.append(Doubt(cause, other, f"{cause.where} moved at several paces, slow and quick"))
    return doubts


def perhaps_another_pace(study: JointStudy, causes: Sequence[Cause]) -> list[Doubt]:
    """Of gravity of another size, where nothing drives any joint: that the clock has another pace."""
    found = [cause for cause in causes if cause.effect == "gravity" and cause.where in AXES]
    if not found or any((episode.driving_nm != 0.0).any() for episode in study.problem.episodes):
        return []
    nominal = np.asarray(study.problem.episodes[0].plant.gravity_m_s2, dtype=float)
    fitted = nominal + np.array([sum(cause.value for cause in found if cause.where == axis) for axis in AXES])
    sizes = float(np.linalg.norm(nominal)), float(np.linalg.norm(fitted))
    if min(sizes) == 0.0 or float(nominal @ fitted) < _SAME_WAY * sizes[0] * sizes[1]:
        return []
    other = f"a second of the recordings is {np.sqrt(sizes[1] / sizes[0]):.3g} s: where nothing drives a joint both are the same"
    return [Doubt(cause, other, "the times or the rate of rows, beside another clock") for cause in found]


def _inertia_of_spring(episodes: Sequence[EpisodeEquations], joint: int) -> float:
    """Which share of a joint's inertia a spring of 1 N m/rad stands for; 0 where its motion tells both apart."""
    rows = [episode.valid_mechanics[:, joint] for episode in episodes]
    paths = [(e.path.position, e.path.velocity, e.path.acceleration) for e in episodes]
    position, velocity, acceleration = (
        np.concatenate([path[i][counts, joint] for path, counts in zip(paths, rows, strict=True)]) for i in range(3)
    )
    if len(position) == 0:
        return 0.0
    inertia = np.concatenate([e.dynamics.by_acceleration[counts, joint, joint] for e, counts in zip(episodes, rows, strict=True)])
    free = np.stack([np.tanh(velocity / _BLURRED_RAD_S), velocity, np.ones_like(velocity)], axis=1)
    left, coefficients = rms_left(position, np.column_stack([inertia * acceleration, free]))
    return max(0.0, -float(coefficients[0])) if left <= _ALIKE * rms_left(position, free)[0] else 0.0
