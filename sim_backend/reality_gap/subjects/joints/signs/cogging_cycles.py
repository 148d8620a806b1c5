"""How many cycles a turn a motor that nobody knows may cog with: the strongest line of what a model leaves over the position.

Of a TriFinger the motors' own number is known (the catalogue). Another's is proposed here, and its amplitude and phase are then
a hypothesis as any other.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.joint_effects import COGGING_CYCLES
from sim_backend.reality_gap.knowledge.known_of_robot import UnknownRobot
from sim_backend.reality_gap.subjects.joints.laws.state import JointState
from sim_backend.reality_gap.subjects.joints.torques.equations import EpisodeEquations

_LEAST_CYCLES = 2.5
"""Within what a joint moved over: fewer are a slow function of the position, which much else is."""
_MOST_A_TURN = 600
_OF_CUTOFF = 0.5
"""Share of the cutoff of compared torques: where a joint passes cycles faster they are smoothed away."""
_MOST_HZ = _OF_CUTOFF * UnknownRobot.cutoff_hz
_LEAST_ROWS, _LEAST_SHARE = 150, 0.1
"""Of a joint's rows, that must be slow enough."""
_LINE_SHARE, _OVER_OTHERS = 0.03, 4.0
"""A line is one if it takes that share of what is left, and so many times what usual numbers of cycles take."""


def with_cycles(start: JointState, episodes: Sequence[EpisodeEquations]) -> JointState:
    """A nominal model whose motors would cog with the cycles that are seen, if they do; as it is where none are."""
    found = start.value(COGGING_CYCLES).astype(float).copy()
    for joint, rows in enumerate(_rows(start, episodes)):
        if rows.shape[1] >= _LEAST_ROWS:
            turn = strongest_line(rows[0], rows[1], rows[2], _MOST_HZ)
            found[joint] = found[joint] if turn is None else turn / (2.0 * np.pi)
    return start if (found == start.value(COGGING_CYCLES)).all() else replace(start, given={**start.given, COGGING_CYCLES: found})


def seen_cogging(start: JointState, episodes: Sequence[EpisodeEquations]) -> dict[int, tuple[float, float]]:
    """Amplitude, N m, and phase, rad, of the lines whose cycles a nominal model was given, by joint.

    A motion in which a joint passes cycles quickly shows them to simulations alone, and these do not find there from nothing: a
    rotor that a cog holds goes nowhere else.
    """
    cycles, usual = start.value(COGGING_CYCLES), PARAMETERS[COGGING_CYCLES].absent
    found = {}
    for joint, (position, velocity, left_nm) in enumerate(_rows(start, episodes)):
        turn = 2.0 * np.pi * float(cycles[joint])
        if cycles[joint] != usual and len(position) >= _LEAST_ROWS:
            rows = np.abs(velocity) * cycles[joint] < _MOST_HZ
            wave = np.stack([np.cos(turn * position[rows]), np.sin(turn * position[rows])], axis=1)
            along = np.concatenate([wave, _slow(position, velocity)[rows]], axis=1)
            # what the motor gave is more than the motion took where the cog holds it back
            cosine, sine = -np.linalg.lstsq(along, left_nm[rows], rcond=None)[0][:2]
            found[joint] = float(np.hypot(cosine, sine)), float(np.arctan2(cosine, sine))
    return found


def _rows(start: JointState, episodes: Sequence[EpisodeEquations]) -> list[np.ndarray]:
    """Of each joint: position, velocity and what the nominal model leaves of its torque, shape (3, r)."""
    errors, found = [e.torque_error(start) for e in episodes], []
    for joint in range(start.joints):
        rows = [e.valid_mechanics[:, joint] for e in episodes]
        parts = [
            np.stack([e.path.position[r, joint], e.path.velocity[r, joint], error[r, joint]])
            for e, r, error in zip(episodes, rows, errors, strict=True)
        ]
        every = np.concatenate(parts, axis=1)
        found.append(every[:, np.isfinite(every).all(axis=0)])
    return found


def _slow(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """What much else makes of a torque, shape (r, 6)."""
    powers = [np.ones_like(position), position, position**2, position**3]
    return np.stack([*powers, velocity, np.tanh(velocity / 0.02)], axis=1)


def strongest_line(position: np.ndarray, velocity: np.ndarray, left_nm: np.ndarray, most_hz: float) -> int | None:
    """Whole cycles a turn of the strongest line in a torque over the position; None if none stands out.

    Args:
        position: of one joint, shape (r,), rad.
        velocity: shape (r,), rad/s.
        left_nm: the torque, shape (r,), N m.
        most_hz: cycles a second beyond which rows are left out.
    """
    span = float(np.subtract(*np.quantile(position, [0.98, 0.02])))
    slow = _slow(position, velocity)
    left = left_nm - slow @ np.linalg.lstsq(slow, left_nm, rcond=None)[0]
    first = int(np.ceil(2.0 * np.pi * _LEAST_CYCLES / max(span, 1e-9)))
    shares = np.zeros(_MOST_A_TURN + 1)
    for turn in range(first, _MOST_A_TURN + 1):
        rows = np.abs(velocity) * turn / (2.0 * np.pi) < most_hz
        if rows.sum() < max(_LEAST_ROWS, _LEAST_SHARE * len(position)):
            break
        wave, own = np.stack([np.cos(turn * position[rows]), np.sin(turn * position[rows])]), left[rows]
        pull = wave @ own
        shares[turn] = pull @ np.linalg.solve(wave @ wave.T + 1e-9 * np.eye(2), pull) / max(float(own @ own), 1e-30)
    asked = shares[shares > 0.0]
    if not len(asked):
        return None
    best = int(np.argmax(shares))
    return best if shares[best] > max(_LINE_SHARE, _OVER_OTHERS * float(np.median(asked))) else None
