"""What arrives at joints in a step, compiled: torques that were recorded, or what a recorded controller makes of the motion."""

import numpy as np

from sim_backend.reality_gap.subjects.joints.rollouts.chain_slots import (
    AHEAD,
    BACK_EMF,
    BRAKE,
    DESIRED,
    GAIN,
    LATE,
    LIMIT,
    OF_GAIN,
    OF_OWN,
    OFFSET,
    ON_BOARD,
    SIDE,
    SPEED,
    TARGET,
)
from sim_backend.reality_gap.subjects.joints.rollouts.link_dynamics import compiled


@compiled
def sum_until(at: float, sums: np.ndarray, held: np.ndarray, window: int, joint: int) -> float:
    """Integral of what has arrived of a recorded torque, in samples; before and after it the first and the last one go on."""
    sample = int(min(max(np.floor(at), 0.0), held.shape[1] - 1.0))
    return sums[window, sample, joint] + (at - sample) * held[window, sample, joint]


@compiled
def _arriving(feedback: np.ndarray, what: int, w: int, at: float, lasts: float, joint: int) -> float:
    """Mean over a step of a target or desired torque that is held from sample to sample; the step begins ``at``, in samples.

    Before the first sample and after the last one these go on.
    """
    last = feedback.shape[2] - 1.0
    first, second = min(max(np.floor(at + 1e-9), 0.0), last), min(max(np.floor(at + lasts - 1e-9), 0.0), last)
    newest = feedback[what, w, int(second), joint]
    if first == second:
        return newest
    share = (at + lasts - second) / lasts
    return share * newest + (1.0 - share) * feedback[what, w, int(first), joint]


@compiled
def _made(
    feedback: np.ndarray,
    w: int,
    sample: int,
    lead: int,
    begin_s: float,
    step_s: float,
    sample_s: float,
    joint: int,
    joints: np.ndarray,
    m: int,
    rotors: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    gained: np.ndarray,
) -> float:
    """Torque that a joint's controller makes of what is reported; none where its law is not known.

    Of its gain, and of the voltage that its motor makes itself, a model may have a share. Targets are those that have come in the
    step that begins ``begin_s`` after its window, ``lead`` samples after the first one.
    """
    row = lead + sample
    at = lead + (begin_s - (joints[LATE, m, joint] if feedback[ON_BOARD, w, row, joint] > 0.5 else 0.0)) / sample_s
    reported = position[joint] + rotors[AHEAD, joint] + joints[OFFSET, m, joint]
    speed = rotors[SPEED, joint] if rotors[SIDE, joint] == 0.0 else velocity[joint] + 0.5 * gained[joint]
    stiffness = joints[OF_GAIN, m, joint] * feedback[GAIN, w, row, joint]
    target = _arriving(feedback, TARGET, w, at, step_s / sample_s, joint)
    asked = stiffness * (target - reported) - feedback[BRAKE, w, row, joint] * speed
    asked += _arriving(feedback, DESIRED, w, at, step_s / sample_s, joint)
    limit = feedback[LIMIT, w, row, joint]
    made = min(max(asked, -limit), limit) - joints[OF_OWN, m, joint] * feedback[BACK_EMF, w, row, joint] * speed
    return 0.0 if np.isnan(made) else made


@compiled
def _delayed(line: np.ndarray, now: int, steps: float, joint: int) -> float:
    """What was made some steps ago, of a line that goes round; between two of them by straight line."""
    back = int(np.floor(steps + 1e-9))
    newer, older = line[max(0, now - back) % len(line), joint], line[max(0, now - back - 1) % len(line), joint]
    return newer + (steps - back) * (older - newer)


@compiled
def arrives(
    feedback: np.ndarray,
    w: int,
    lead: int,
    now: int,
    step_s: float,
    sample_s: float,
    held_steps: int,
    joint: int,
    joints: np.ndarray,
    m: int,
    rotors: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    gained: np.ndarray,
    made: np.ndarray,
    line: np.ndarray,
) -> float:
    """What arrives in a step of a joint's controller, which computes its torque now or holds it; ``made``, ``line`` remember."""
    sample = int(now * step_s / sample_s + 1e-9)
    on_board = feedback[ON_BOARD, w, lead + sample, joint] > 0.5
    if held_steps == 0 or on_board or now % held_steps == 0:
        made[joint] = _made(
            feedback, w, sample, lead, now * step_s, step_s, sample_s, joint, joints, m, rotors, position, velocity, gained
        )
    line[now % len(line), joint] = made[joint]
    # a step moves velocities by what acts half a step before and after its begin
    steps = joints[LATE, m, joint] / step_s + 0.5 * (held_steps > 0)
    return made[joint] if on_board else _delayed(line, now, max(0.0, steps), joint)
