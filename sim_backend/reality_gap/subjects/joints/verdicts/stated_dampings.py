"""What the damping of a stated controller stands for where nobody recorded what it sent: friction that grows with speed.

With targets that have no velocity such a controller sends ``stiffness (target - position) - damping velocity``. Its damping is
the friction of a bearing then, newton metre for newton metre, but held for a row, which is half a row late: to first order the
loop of a rotor that has less inertia. And a motor that makes ``c`` of what is sent, with a stiffness that is ``1 / c`` of the
stated one, leaves the stiffness as stated and ``c`` of the damping: two causes in place of one wrong number.
"""

from collections.abc import Callable, Sequence

import numpy as np

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.knowledge.joint_effects import ARMATURE, POSITION_GAIN, TORQUE_CONSTANT, VISCOUS_FRICTION
from sim_backend.reality_gap.verdict import Cause, Doubt


def plain_dampings(laws: Sequence[Feedback]) -> np.ndarray:
    """Dampings of controllers that send nothing but what positions and velocities ask for, shape (k,), N m s/rad; NaN elsewhere.

    Where torque is desired beside that, it shows what a motor makes of torques, or holds a target's velocity; and what brakes a
    motor that is driven by voltage is its own.

    Args:
        laws: of the recordings, at least one, shapes (s, k).
    """
    plain = [
        ~((np.nan_to_num(law.desired_nm) != 0.0) | (np.nan_to_num(law.back_emf_nm_s_rad) != 0.0)).any(axis=0) & law.is_known
        for law in laws
    ]
    damping = np.median(np.concatenate([np.nan_to_num(law.damping_nm_s_rad) for law in laws]), axis=0)
    return np.where(np.all(plain, axis=0), damping, np.nan)


def perhaps_other_damping(
    causes: Sequence[Cause],
    names: Sequence[str],
    damping_nm_s_rad: np.ndarray,
    nominal: Callable[[Cause], float],
    row_s: float,
) -> list[Doubt]:
    """Of causes that another damping of a stated controller is instead.

    Args:
        causes: of the motion.
        names: of the joints, k.
        damping_nm_s_rad: as stated, of :func:`plain_dampings` and where nobody recorded torques, shape (k,); NaN at other joints.
        nominal: the value of a cause in the nominal model.
        row_s: of the recordings, for which what a controller sends is held.
    """
    found = {(f"{cause.effect}.{cause.parameter}", cause.where): cause for cause in causes}
    doubts = []
    for name, damping in zip(names, damping_nm_s_rad, strict=True):
        if not damping > 0.0:
            continue
        rubs, rotor = (found.get((key, name)) for key in (VISCOUS_FRICTION, ARMATURE))
        gain, constant = (found.get((key, name)) for key in (POSITION_GAIN, TORQUE_CONSTANT))
        if rubs is not None and (share := 1.0 + (more := rubs.value - nominal(rubs)) / damping) > 0.0:
            doubts.append(_doubt(rubs, share))
            if rotor is not None and 0.0 < (nominal(rotor) - rotor.value) / more <= row_s:
                doubts.append(_doubt(rotor, share))
        if gain is not None and constant is not None and _keeps_the_stiffness(gain, constant):
            doubts += [_doubt(cause, 1.0 + constant.value) for cause in (gain, constant)]
    return doubts


def _keeps_the_stiffness(gain: Cause, constant: Cause) -> bool:
    """Whether a motor makes of a controller's stiffness what is stated, within the errors of both."""
    kept, off = gain.value * (1.0 + constant.value), (_half(gain) / gain.value, _half(constant) / (1.0 + constant.value))
    return bool(abs(kept - 1.0) <= np.hypot(*off))


def _half(cause: Cause) -> float:
    return 0.5 * (cause.interval_90[1] - cause.interval_90[0])


def _doubt(cause: Cause, share: float) -> Doubt:
    other = f"the controller of {cause.where} damps {share:.3g} times as much as is stated, which moves it in the same way"
    return Doubt(cause, other, f"the torques that the controller of {cause.where} sends, beside its targets")
