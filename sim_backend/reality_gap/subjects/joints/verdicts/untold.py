"""What the data of joints cannot tell, in words."""

from collections.abc import Sequence

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import OFFSET, TILT
from sim_backend.reality_gap.knowledge.known_of_robot import KnownTriFinger
from sim_backend.reality_gap.knowledge.value_errors import place_in_finger
from sim_backend.reality_gap.subjects.joints.identification import JointStudy
from sim_backend.reality_gap.subjects.joints.slides import told_speed
from sim_backend.reality_gap.subjects.joints.verdicts.causes import is_clear, told
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_unknown_robot import unknown_of
from sim_backend.reality_gap.verdict import Cause

_SLOW_RAD_S = 0.3
"""A joint that is slower shows hardly anything that needs speed."""
_FIRST_JOINT = "base_to_upper"


def untold(study: JointStudy, causes: Sequence[Cause]) -> list[str]:
    """Whatever these causes are, and of which of them nothing is sure."""
    said = ["whether all torques and all masses are off by the same share: no motion shows it"]
    speed = np.max([np.quantile(np.abs(e.path.velocity), 0.99, axis=0) for e in study.problem.episodes], axis=0)
    if study.is_of_many and (unclear := [cause for cause in causes if not is_clear(study, cause)]):
        said.append(
            f"whether there is {', '.join(told(unclear))}: among so many causes values as large as these are often others'"
        )
    said += [_with_tilt(turned)] if (turned := turned_bases(study, causes)) else []
    said += _of_slow_joints(study, speed)
    unjudged = [name for name, judged in zip(study.problem.names, study.is_judged, strict=True) if not judged]
    if isinstance(study.robot, KnownTriFinger) and unjudged:
        said.append(f"anything else about {', '.join(unjudged)}: what was found there left no rows of its mechanics to judge")
    if all(e.path.joints.measured_torque_nm is None for e in study.problem.episodes):
        said.append("whether torque is lost before or after the motor's current: no measured torque")
    return said if isinstance(study.robot, KnownTriFinger) else [*said, *unknown_of(study)]


def turned_bases(study: JointStudy, causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """Encoders of first joints that are off for sure where a robot differs everywhere: a table that is tilted does the same.

    Gravity is turned about a first joint's axis by either, and while the errors of all encoders are unknown no motion tells them
    apart.
    """
    if not study.is_of_many or any((cause.effect, cause.parameter) in TILT and is_clear(study, cause) for cause in causes):
        return ()
    return tuple(
        cause
        for cause in causes
        if (cause.effect, cause.parameter) == OFFSET and place_in_finger(cause.where) == _FIRST_JOINT and is_clear(study, cause)
    )


def _with_tilt(turned: Sequence[Cause]) -> str:
    return f"whether {', '.join(told(turned))} is not a tilt of the table: either turns gravity about axes of first joints"


def _of_slow_joints(study: JointStudy, speed_rad_s: np.ndarray) -> list[str]:
    """Hinges, and slides, that are slow all the time; speeds of shape (k,)."""
    is_slide, names = study.problem.episodes[0].plant.is_slide, np.array(study.problem.names)
    is_slow = speed_rad_s < _SLOW_RAD_S
    return [
        f"anything that needs speed about {', '.join(names[slow])}: "
        f"slower than {told_speed(_SLOW_RAD_S, is_slide=slides)} all the time"
        for slow, slides in ((is_slow & ~is_slide, False), (is_slow & is_slide, True))
        if slow.any()
    ]


def perhaps_absent(fitted: Sequence[Cause], causes: Sequence[Cause]) -> list[str]:
    """Effects none of whose numbers is surely away from absent."""
    named = {cause.effect for cause in causes}
    unsure = [cause for cause in fitted if cause.effect not in named]
    return [f"whether there is {', '.join(told(unsure))}: the interval holds that there is none"] if unsure else []


def too_little(little: Sequence[Cause]) -> list[str]:
    """Causes that are smaller than what sessions of this length show."""
    said = ", ".join(told(little))
    return (
        [f"whether there is {said}: less of it than sessions of this length show is often another cause in disguise"]
        if little
        else []
    )
