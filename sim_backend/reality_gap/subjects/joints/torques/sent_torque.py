"""The controller equation: what was sent is what the safety pipeline makes of targets and of what the encoders reported."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim_backend.driver.safety import applied_torque_nm
from sim_backend.reality_gap.recording import JointSignals
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.torques.mechanics import JointImage

_GAIN, _DAMPING, LATENESS, _OFF = (
    "position_gain.factor",
    "safety_damping.factor",
    "timing_jitter.std_s",
    "controller_restart.off",
)
KEYS = frozenset({_GAIN, _DAMPING, LATENESS, _OFF})
"""Numbers that have an image here."""
_TELLING_NM = 1e-4
"""Two commands whose torques differ by less cannot be told apart."""


class LateCommands(NamedTuple):
    """For each new position target whose samples are all known, those in which what was sent is what the target before it makes.

    ``steps`` has shape (n,).

    ``beside`` and ``left`` are sums over samples and joints of squares, (N m)^2: of what was sent beyond what the pipeline makes,
    and of that beyond what it makes of targets that are so late.
    """

    steps: np.ndarray
    beside: float
    left: float


class SentTorque:
    """The safety pipeline of k joints in one episode of s samples.

    Args:
        joints: as recorded, with velocities and position targets.
        sent_nm: with gaps filled, shape (s, k), N m.
        step_s: of the samples.
    """

    def __init__(self, joints: JointSignals, sent_nm: np.ndarray, step_s: float) -> None:
        assert joints.position_target_rad is not None
        self._joints, self._sent, self._step_s = joints, sent_nm, step_s
        desired = joints.desired_torque_nm
        self._desired = desired if desired is not None else np.zeros_like(joints.position_rad)
        self._target = joints.position_target_rad

    def residual(self, state: JointState) -> np.ndarray:
        """What was sent beyond what the pipeline makes, shape (s, k), N m."""
        residual = self._sent - self._made(state, self._desired, self._target)
        off = state.value(_OFF)[0]
        return residual if off == 0.0 else residual * 0.0 + self._sent

    def _made(self, state: JointState, desired: np.ndarray, target: np.ndarray) -> np.ndarray:
        assert self._joints.velocity_rad_s is not None
        return applied_torque_nm(
            desired,
            target,
            self._joints.position_rad,
            self._joints.velocity_rad_s,
            position_gain_factor=state.value(_GAIN),
            damping_factor=state.value(_DAMPING),
        )

    def images(self, state: JointState, terms: Sequence[Term]) -> list[JointImage]:
        """A term of one joint has an image in that joint only, so that terms of all joints are taken together."""
        found: list[JointImage] = []
        taken: dict[tuple[str, float], np.ndarray] = {}
        for i, term in enumerate(terms):
            if term.key not in KEYS:
                continue
            if (term.key, term.probe) not in taken:
                taken[term.key, term.probe] = self._image(state, term)
            image = taken[term.key, term.probe]
            joints = [term.index] if state.width(term.key) > 1 else range(image.shape[1])
            found += [(i, j, image[:, j]) for j in joints if image[:, j].any()]
        return found

    def late_commands(self, state: JointState) -> LateCommands:
        """How late new position targets came, by what was sent."""
        starts = np.flatnonzero(_changes(self._target))
        of_position = starts[~_changes(self._desired)[starts]]
        base = self._made(state, self._desired, self._target)
        difference = self._made(state, *_command_before(self._desired, self._target)) - base
        size = (difference**2).sum(axis=1)
        share = ((self._sent - base) * difference).sum(axis=1) / np.maximum(size, _TELLING_NM**2)
        late = np.clip(np.round(share), 0.0, 1.0)  # NaN in a gap
        ends = np.append(starts[1:], len(late))[np.searchsorted(starts, of_position)]
        holds = [(start, end) for start, end in zip(of_position, ends, strict=True) if size[start] > _TELLING_NM**2]
        told = [(start, end) for start, end in holds if np.isfinite(late[start:end]).all()]
        beside = self._sent - base
        squares = tuple(float(np.nansum(each**2)) for each in (beside, beside - late[:, None] * difference))
        return LateCommands(np.array([late[start:end].sum() for start, end in told]), *squares)

    def _image(self, state: JointState, term: Term) -> np.ndarray:
        """What a term does if all joints have it, shape (s, k)."""
        base = self._made(state, self._desired, self._target)
        if term.key == LATENESS:
            since_s = _time_since_change_s(self._target, self._step_s)
            late = np.maximum(0.0, 1.0 - since_s / (2.0 * term.probe))[:, None]  # roughly the chance of half-normal lateness
            before = self._made(state, *_command_before(self._desired, self._target))
            return late * (before - base) / term.probe
        if term.key == _OFF:
            return -base
        moved = replace(state, given={**state.given, term.key: state.value(term.key) + term.probe})
        return (self._made(moved, self._desired, self._target) - base) / term.probe


def _command_before(desired: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each sample the command that the present one replaced."""
    starts = np.concatenate([[1], np.flatnonzero(_changes(target))])  # none replaced the first command
    latest = np.searchsorted(starts[1:], np.arange(len(target)), side="right")
    before = starts[latest] - 1
    return desired[before], target[before]


def _time_since_change_s(target: np.ndarray, step_s: float) -> np.ndarray:
    starts = np.concatenate([[0], np.flatnonzero(_changes(target))])
    latest = starts[np.searchsorted(starts, np.arange(len(target)), side="right") - 1]
    return step_s * (np.arange(len(target)) - latest)


def _changes(target: np.ndarray) -> np.ndarray:
    same = (target[1:] == target[:-1]) | (np.isnan(target[1:]) & np.isnan(target[:-1]))
    return np.concatenate([[False], ~same.all(axis=1)])
