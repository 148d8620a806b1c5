"""How warm motors get from their torque, where their temperature was recorded."""

from collections.abc import Sequence

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import MOTOR_RISE, MOTOR_WARMS_S
from sim_backend.reality_gap.recording import JointSignals
from sim_backend.reality_gap.subjects.joints.laws.state import JointState


def measured_warmth_k(joints: JointSignals) -> np.ndarray | None:
    """Rises of the motors' temperatures with gaps filled, shape (k, s), K; NaN of motors without, None if no motor has any."""
    if joints.temperature_rise_k is None:
        return None
    rows, found = np.arange(len(joints.position_rad)), np.full_like(joints.temperature_rise_k.T, np.nan)
    for j, column in enumerate(joints.temperature_rise_k.T):
        known = np.isfinite(column)
        if known.any():
            found[j] = np.interp(rows, rows[known], column[known])
    return found


def with_measured_heat(
    start: JointState, torques_nm: Sequence[np.ndarray], warmth_k: Sequence[np.ndarray | None], step_s: Sequence[float]
) -> JointState:
    """A nominal model whose motors get as warm as their recorded temperatures say.

    Without a loss for each kelvin this changes nothing. A rise that was stated stays as it is, and so does a time constant.

    Args:
        start: the nominal model.
        torques_nm: that drove each recording, shapes (k, s).
        warmth_k: of its motors, as :func:`measured_warmth_k` gives it.
        step_s: of its samples.
    """
    changed = dict[tuple[str, int], float]()
    for j in range(start.joints):
        seen = [
            (torque[j], warmth[j], step)
            for torque, warmth, step in zip(torques_nm, warmth_k, step_s, strict=True)
            if warmth is not None and np.isfinite(warmth[j]).all()
        ]
        if seen and is_usual(start, MOTOR_RISE, j):
            stated_s = None if is_usual(start, MOTOR_WARMS_S, j) else float(start.value(MOTOR_WARMS_S)[j])
            rise, warms_s = _heating(seen, stated_s)
            if rise > 0.0:
                changed |= {(MOTOR_RISE, j): rise, (MOTOR_WARMS_S, j): warms_s}
    return start.with_values(changed)


def is_usual(state: JointState, key: str, joint: int) -> bool:
    """Whether nothing was stated or measured of a joint's parameter."""
    return float(state.value(key)[joint]) == PARAMETERS[key].absent


def is_in_balance(state: JointState, joint: int) -> bool:
    """Whether a motor's temperature was recorded and hardly changed, so that nothing says how it gets there."""
    is_slowest = float(state.value(MOTOR_WARMS_S)[joint]) == PARAMETERS[MOTOR_WARMS_S].upper
    return is_slowest and not is_usual(state, MOTOR_RISE, joint)


def _heating(seen: Sequence[tuple[np.ndarray, np.ndarray, float]], stated_s: float | None) -> tuple[float, float]:
    """Kelvins for each (N m)^2, and the time constant in s, of torques and rises of one motor in several recordings.

    Of a first-order motor, a rise changes by ``-1 / time_constant`` of its integral and ``rise / time_constant`` of that of the
    squared torque. Where that has no answer, because the motor hardly gets warmer, it is taken to be in balance.
    """
    sides, changes = [], []
    for torque, warmth, step_s in seen:
        sides.append(step_s * np.cumsum(np.stack([-warmth, torque**2]), axis=1).T)
        changes.append(warmth - warmth[0])
    images, changed = np.concatenate(sides), np.concatenate(changes)
    if stated_s is None:
        (by_rise, by_torque), *_ = np.linalg.lstsq(images, changed, rcond=None)
    else:
        by_rise = 1.0 / stated_s
        by_torque = float(images[:, 1] @ (changed - by_rise * images[:, 0])) / max(float(images[:, 1] @ images[:, 1]), 1e-30)
    longest = PARAMETERS[MOTOR_WARMS_S].upper
    if by_torque > 0.0 and by_rise * longest >= 1.0:
        return float(by_torque / by_rise), float(max(1.0 / by_rise, PARAMETERS[MOTOR_WARMS_S].lower))
    heats = np.mean(np.concatenate([torque for torque, _, _ in seen]) ** 2)
    warmth = np.mean(np.concatenate([warmth for _, warmth, _ in seen]))
    return (float(warmth / heats) if heats > 0.0 else 0.0), longest if stated_s is None else stated_s
