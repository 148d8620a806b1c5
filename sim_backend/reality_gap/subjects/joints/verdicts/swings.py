"""What the period of a swing does not tell apart: a spring and less inertia, gravity and the pace of the clock.

A swing of one frequency has accelerations that are its positions times a constant. Whether more torque draws a pendulum back or
less of it has to be moved, its period alone does not say. And where nothing drives any joint and no spring acts, a clock that
lets s seconds pass for each told one makes gravity s squared of what it is at every joint; friction changes with it.
"""

from collections.abc import Sequence

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import GRAVITY_OFFSET, JOINT_STIFFNESS
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.laws.body_law import gravity_of
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations
from sim_backend.reality_gap.subjects.joints.verdicts.readings import free_columns, rms_left
from sim_backend.reality_gap.verdict import AXES, Cause, Doubt

_ALIKE = 1.0 / 3.0
"""Of a spring's torque inertia, friction and a constant leave less where a joint swings at one pace."""
_SAME_WAY = 0.99
"""Cosine of the angle between nominal and fitted gravity, beyond which a base is tilted and no clock is wrong."""


def perhaps_less_inertia(study: JointStudy, causes: Sequence[Cause]) -> list[Doubt]:
    """Of each spring that draws a joint back: that the joint has less inertia, where its motion does not tell them apart."""
    doubts = []
    for cause in causes:
        if f"{cause.effect}.{cause.parameter}" != JOINT_STIFFNESS or cause.where not in study.problem.names:
            continue
        joint = study.problem.names.index(cause.where)
        more = cause.value - study.problem_start(JOINT_STIFFNESS, joint)
        share = more * _inertia_of_spring(study.problem.episodes, joint)
        if 0.0 < share < 1.0:
            other = (
                f"the model has too much inertia at {cause.where}, {share:.0%} of it: at one pace of swinging both are the same"
            )
            doubts.append(Doubt(cause, other, f"{cause.where} moved at several paces, slow and quick"))
    return doubts


def perhaps_another_pace(study: JointStudy, causes: Sequence[Cause]) -> list[Doubt]:
    """Of gravity of another size, where neither a motor nor a spring drives any joint: that the clock has another pace."""
    named = [(f"{cause.effect}.{cause.parameter}", cause) for cause in causes]
    found = {cause.where: cause for key, cause in named if key == GRAVITY_OFFSET and cause.where in AXES}
    plant, start = study.problem.episodes[0].plant, study.start
    is_sprung = plant.is_sprung or start.value(JOINT_STIFFNESS).any() or JOINT_STIFFNESS in dict(named)
    if not found or is_sprung or any((episode.driving_nm != 0.0).any() for episode in study.problem.episodes):
        return []
    nominal, offset = gravity_of(start, plant.gravity_m_s2), start.value(GRAVITY_OFFSET)
    fitted = nominal + [found[axis].value - offset[i] if axis in found else 0.0 for i, axis in enumerate(AXES)]
    sizes = float(np.linalg.norm(nominal)), float(np.linalg.norm(fitted))
    if min(sizes) == 0.0 or float(nominal @ fitted) < _SAME_WAY * sizes[0] * sizes[1]:
        return []
    other = f"a second of the recordings is {np.sqrt(sizes[1] / sizes[0]):.3g} s: where nothing drives a joint both look alike"
    if len(plant.names) == 1:
        other = f"{other}, and so does {sizes[0] / sizes[1]:.2g} times the model's inertia"
    return [Doubt(cause, other, "the times or the rate of rows, beside another clock") for cause in found.values()]


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
    free = free_columns(velocity)
    left, coefficients = rms_left(position, np.column_stack([inertia * acceleration, free]))
    return max(0.0, -float(coefficients[0])) if left <= _ALIKE * rms_left(position, free)[0] else 0.0
