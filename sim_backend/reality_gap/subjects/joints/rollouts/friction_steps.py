"""A step of joints with dry friction, compiled: its impulses, also of bearings that give and creep before they slip."""

import numpy as np

from sim_backend.reality_gap.subjects.joints.rollouts.chain_slots import CREEP, GIVE, SIDE, SPEED
from sim_backend.reality_gap.subjects.joints.rollouts.link_dynamics import compiled

_SWEEPS, _SETTLED = 50, 1e-7
"""Of the impulses of friction at most, and the change, as a share of the largest bound, at which they have settled."""
_DIVERGED = 1e4
"""Of a velocity, rad/s."""


@compiled
def inverted(matrix: np.ndarray, room: np.ndarray, out: np.ndarray) -> None:
    """The inverse of a positive definite matrix, by Cholesky; all of shape (k, k), reciprocals on the diagonal of ``room``."""
    k = len(matrix)
    for i in range(k):
        for j in range(i + 1):
            total = matrix[i, j]
            for a in range(j):
                total -= room[i, a] * room[j, a]
            room[i, j] = 1.0 / np.sqrt(total) if i == j else total * room[j, j]
    for c in range(k):
        for i in range(c, k):
            total = 1.0 if i == c else 0.0
            for a in range(c, i):
                total -= room[i, a] * out[a, c]
            out[i, c] = total * room[i, i]
        for i in range(k - 1, c - 1, -1):
            total = out[i, c]
            for a in range(i + 1, k):
                total -= room[a, i] * out[a, c]
            out[i, c] = out[c, i] = total * room[i, i]


@compiled
def _held(bend: float, give: float, creep: float, step_s: float, velocity: float, stops: float) -> float:
    """Share of its friction that a bearing holds after a step, -1 to 1, which gives and creeps until it slips at 1.

    A spring and a damper in series: the share grows by what the joint moves less what it creeps, over what it gives. It is solved
    for the end of the step, at which the friction has changed ``velocity`` by that share of ``stops``.
    """
    return min(max((give * bend + step_s * velocity) / (give + step_s * (creep + stops)), -1.0), 1.0)


@compiled
def _rub(
    inverse: np.ndarray,
    bound: np.ndarray,
    joints: np.ndarray,
    m: int,
    bend: np.ndarray,
    step_s: float,
    velocity: np.ndarray,
    impulse: np.ndarray,
) -> None:
    """Stop what dry friction can stop: impulses within their bounds that leave joints at rest or oppose their motion.

    Of bearings that give or creep they are the share of the bounds that :func:`_held` says. ``velocity`` is that after the step
    without friction and is moved on; ``impulse`` and ``bend`` are those of the step before, and ``bend`` stays so.
    """
    k, largest = len(bound), 0.0
    for j in range(k):
        most = bound[j] * step_s
        largest = max(largest, most)
        impulse[j] = min(max(impulse[j], -most), most)
        if impulse[j] != 0.0:
            for i in range(k):
                velocity[i] += inverse[i, j] * impulse[j]
    if largest == 0.0:
        return
    for _ in range(_SWEEPS):
        change = 0.0
        for j in range(k):
            most = bound[j] * step_s
            if most == 0.0:
                continue
            give, creep, own = joints[GIVE, m, j], joints[CREEP, m, j], inverse[j, j]
            if give + creep > 0.0:
                wanted = -most * _held(bend[j], give, creep, step_s, velocity[j] - own * impulse[j], own * most)
            else:
                wanted = min(max(impulse[j] - velocity[j] / own, -most), most)
            by = wanted - impulse[j]
            if by != 0.0:
                impulse[j] = wanted
                change = max(change, abs(by))
                for i in range(k):
                    velocity[i] += inverse[i, j] * by
        if change <= _SETTLED * largest:
            return


@compiled
def moved_on(
    inverse: np.ndarray,
    rest: np.ndarray,
    bound: np.ndarray,
    joints: np.ndarray,
    m: int,
    rotors: np.ndarray,
    bend: np.ndarray,
    step_s: float,
    position: np.ndarray,
    velocity: np.ndarray,
    gained: np.ndarray,
    impulse: np.ndarray,
) -> bool:
    """Move joints on by impulses that are left, and by friction; ``gained`` is by how much. Whether they do not diverge."""
    k, fastest = len(velocity), 0.0
    for i in range(k):
        gained[i] = velocity[i]
        for j in range(k):
            velocity[i] += inverse[i, j] * rest[j]
    _rub(inverse, bound, joints, m, bend, step_s, velocity, impulse)
    for j in range(k):
        give, creep = joints[GIVE, m, j], joints[CREEP, m, j]
        if give + creep > 0.0:
            speed = rotors[SPEED, j] if rotors[SIDE, j] == 0.0 else velocity[j]
            bend[j] = _held(bend[j], give, creep, step_s, speed, 0.0)
        position[j] += step_s * velocity[j]
        gained[j] = velocity[j] - gained[j]
        fastest = max(fastest, abs(velocity[j]))
    return fastest < _DIVERGED
