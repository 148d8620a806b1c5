"""What the damping of a stated controller stands for where nobody recorded what it sent: friction that grows with speed.

With targets that have no velocity such a controller sends ``stiffness (target - position) - damping velocity``, and perhaps a
torque that is asked for beside that. Its damping is the friction of a bearing then, newton metre for newton metre, but held for
a row, which is half a row late: to first order the loop of a rotor that has less inertia. And where no torque is asked for a
motor that makes ``c`` of what is sent, with a stiffness that is ``1 / c`` of the stated one, leaves the stiffness as stated and
``c`` of the damping: two causes in place of one wrong number.
"""

from collections.abc import Callable, Sequence

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import ARMATURE, POSITION_GAIN, TORQUE_CONSTANT, VISCOUS_FRICTION
from sim_backend.reality_gap.recording import JointSignals
from sim_backend.reality_gap.verdict import Cause, Doubt

_MOST_TIMES = 10.0
"""By so much a damping may be stated too small."""
_ROUNDED = 1e-6
"""Share of a torque that is nothing but rounding."""
_ONE_DAMPING = 0.1
"""Share by which stated dampings may differ: no factor of two that differ by more is one friction."""


def braking_dampings(recorded: Sequence[JointSignals]) -> np.ndarray:
    """As stated, of controllers whose targets have no velocity, shape (k,), N m s/rad; NaN at other joints, and of several.

    What brakes a motor that is driven by voltage is its own.

    Args:
        recorded: signals of the recordings, at least one.
    """
    names, known = recorded[0].names, [(each, each.feedback) for each in recorded if each.feedback is not None]
    if len(known) < len(recorded):
        return np.full(len(names), np.nan)
    brakes = []
    for each, law in known:
        beside_nm = 0.0 if each.desired_torque_nm is None else each.desired_torque_nm
        of_velocity_nm = np.abs(np.nan_to_num(law.desired_nm) - np.nan_to_num(beside_nm))
        is_plain = (of_velocity_nm <= _ROUNDED * np.abs(np.nan_to_num(law.desired_nm))) & ~(law.back_emf_nm_s_rad > 0.0)
        brakes.append(law.is_known & is_plain.all(axis=0))
    stated = np.concatenate([law.damping_nm_s_rad for _, law in known])
    is_one = np.ptp(stated, axis=0) <= _ONE_DAMPING * np.abs(stated).max(axis=0)
    return np.where(np.all(brakes, axis=0) & is_one, np.median(stated, axis=0), np.nan)


def are_asked_for_torques(recorded: Sequence[JointSignals]) -> np.ndarray:
    """Joints whose controllers add a torque to what positions ask for, shape (k,): it shows what their motors make of torques."""
    laws = [law for each in recorded if (law := each.feedback) is not None]
    return np.any(
        [np.zeros(len(recorded[0].names)), *((np.nan_to_num(law.desired_nm) != 0.0).any(axis=0) for law in laws)], axis=0
    )


def perhaps_other_damping(
    causes: Sequence[Cause],
    names: Sequence[str],
    damping_nm_s_rad: np.ndarray,
    nominal: Callable[[Cause], float],
    row_s: float,
    are_asked: np.ndarray,
) -> list[Doubt]:
    """Of causes that another damping of a stated controller is instead.

    Args:
        causes: of the motion.
        names: of the joints, k.
        damping_nm_s_rad: as stated, of :func:`braking_dampings` and where nobody recorded torques, shape (k,); NaN at other
            joints.
        nominal: the value of a cause in the nominal model.
        row_s: of the recordings, for which what a controller sends is held.
        are_asked: joints whose controllers add a torque, as :func:`are_asked_for_torques` says, shape (k,).
    """
    found = {(f"{cause.effect}.{cause.parameter}", cause.where): cause for cause in causes}
    doubts = []
    for name, damping, is_asked in zip(names, damping_nm_s_rad, are_asked, strict=True):
        if not damping > 0.0:
            continue
        rubs, rotor = (found.get((key, name)) for key in (VISCOUS_FRICTION, ARMATURE))
        gain, constant = (found.get((key, name)) for key in (POSITION_GAIN, TORQUE_CONSTANT))
        more = 0.0 if rubs is None else rubs.value - nominal(rubs)
        if rubs is not None and 0.0 < (share := 1.0 + more / damping) < _MOST_TIMES:
            doubts.append(_doubt(rubs, share))
            if rotor is not None and 0.0 < (nominal(rotor) - rotor.value) / more <= row_s:
                doubts.append(_doubt(rotor, share))
        if not is_asked and gain is not None and constant is not None and _keeps_the_stiffness(gain, constant):
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
