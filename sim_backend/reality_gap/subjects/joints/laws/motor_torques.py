"""What the motors of k joints gave along one recorded motion, as the motor law makes it of what was sent or measured."""

import functools
from collections import OrderedDict
from dataclasses import replace

import numpy as np

from sim_backend.reality_gap.knowledge.joint_effects import Channel, keys_of
from sim_backend.reality_gap.subjects.joints.laws import motor_law
from sim_backend.reality_gap.subjects.joints.laws.heating import measured_warmth_k
from sim_backend.reality_gap.subjects.joints.laws.plant import Plant
from sim_backend.reality_gap.subjects.joints.laws.state import JointState, Term
from sim_backend.reality_gap.subjects.joints.laws.trajectory import Trajectory, filled_gaps

BEFORE_CURRENT = frozenset(keys_of(Channel.CURRENT))
"""Parameters that change the current; all others act on what the current gives."""
_KEPT_BYTES = 64_000_000
"""Of results of the law that are kept, for each episode."""
_IS_BEFORE = np.array([key in BEFORE_CURRENT for key in motor_law.VECTOR])


class MotorTorques:
    """The motors along one episode of s samples.

    Args:
        path: the smoothed episode.
        plant: whose joints they move.

    Raises:
        ValueError: the episode has no torque.
    """

    def __init__(self, path: Trajectory, plant: Plant) -> None:
        self._path, self._plant = path, plant
        sent, measured = path.joints.commanded_torque_nm, path.joints.measured_torque_nm
        if sent is None and measured is None:
            raise ValueError(f"episode {path.recording.name} has no torque")
        self.sent_nm = None if sent is None else filled_gaps(sent)
        """What was sent with gaps filled, shape (s, k), N m; None if it is not known."""
        given, acting = _given(sent, measured)
        driving = filled_gaps(given)
        self.driving_nm = np.ascontiguousarray(driving.T)
        """What was sent, or measured where nothing else is known, with gaps filled, shape (k, s), N m."""
        self.measured_nm = None if acting is None else np.ascontiguousarray(filled_gaps(acting).T)
        """What was measured of the current beside what was sent, shape (k, s), N m; None without both."""
        self.known = ~np.isnan(given if acting is None else acting)
        """Samples whose torque that drives the mechanics is no filled gap, shape (s, k)."""
        self.warmth_k = measured_warmth_k(path.joints)
        """How much warmer than their surroundings motors were, shape (k, s), K; NaN, or None, where nobody measured it."""
        self._total = np.abs(driving).sum(axis=1)
        self._unmeasured = np.full(len(driving), np.nan)
        moves = zip(path.fast_position.T, path.fast_velocity.T, strict=True)
        self._motions = [motor_law.JointMotion(position, velocity) for position, velocity in moves]
        self._step_s, law = path.step_s, path.joints.feedback
        made = np.isin(path.joints.names, path.joints.not_recorded)
        self._is_of_targets = made & (np.zeros(len(made), bool) if law is None else law.is_on_board)
        """Joints whose torque is what a loop beside the motor made of targets: these are what comes late, shape (k,)."""
        self._known: OrderedDict[tuple[int, bool, bytes], tuple[np.ndarray, np.ndarray, np.ndarray]] = OrderedDict()
        """The last results of the law: most questions are about one joint, and leave the motors of all others as they are."""

    @property
    def joints(self) -> int:
        """How many."""
        return len(self.driving_nm)

    @property
    def acting_nm(self) -> np.ndarray:
        """Torques that drive the mechanics: measured where they are known, shape (k, s), N m."""
        return self.driving_nm if self.measured_nm is None else self.measured_nm

    def along(self, state: JointState, j: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Torque of the current, torque left at the joint, and play, at full rate; shape (s,)."""
        values = state.motor(j)
        if self.measured_nm is None:
            return self._law(self.driving_nm, values, j)
        absent = motor_law.absent_values()
        before, after = np.where(_IS_BEFORE, values, absent), np.where(_IS_BEFORE, absent, values)
        current = self._law(self.driving_nm, before, j)[0]
        _, net, play = self._law(self.measured_nm, after, j)
        return current, net, play

    def along_sent(self, state: JointState, j: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As :meth:`along`, driven by what was sent: images must not hold the noise that residuals hold."""
        return self._law(self.driving_nm, state.motor(j), j)

    def later_targets_nm(self, j: int) -> np.ndarray | None:
        """What a joint's torque loses when its targets come a row later, shape (s,), N m; None if it is not made of targets."""
        return self.driving_nm[j] - self._of_late_targets_nm(j, self._step_s) if self._is_of_targets[j] else None

    def _of_late_targets_nm(self, j: int, delay_s: float) -> np.ndarray:
        """What a loop beside the motor made of late targets and desired torques, where the joint was, shape (s,), N m."""
        joints = self._path.joints
        assert joints.feedback is not None
        law, position = joints.feedback.at((slice(None), j)), joints.position_rad[:, j]
        velocity = np.gradient(position, self._step_s) if joints.velocity_rad_s is None else joints.velocity_rad_s[:, j]
        late = max(0.0, delay_s) / self._step_s
        whole = int(np.floor(late + 1e-9))
        newer, older = (np.maximum(0, np.arange(len(position)) - whole - more) for more in (0, 1))

        def came(sent: np.ndarray) -> np.ndarray:
            return sent[newer] + (late - whole) * (sent[older] - sent[newer])

        of_late = replace(law, target_rad=came(law.target_rad), desired_nm=came(law.desired_nm))
        return filled_gaps(of_late.torque_nm(position, velocity)[:, None])[:, 0]

    def _law(self, torques_nm: np.ndarray, values: np.ndarray, j: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        torque_nm, key = torques_nm[j], (j, torques_nm is self.driving_nm, values.tobytes())
        if key not in self._known:
            external = self._external_nm[j] if motor_law.needs_external(values) else self._total
            if self._is_of_targets[j] and torques_nm is self.driving_nm:
                delay_s, values = motor_law.in_time(values)
                torque_nm = torque_nm if delay_s == 0.0 else self._of_late_targets_nm(j, delay_s)
            warmth = self._unmeasured if self.warmth_k is None else self.warmth_k[j]
            found = motor_law.along(torque_nm, self._total, self._motions[j], external, warmth, self._step_s, values)
            for each in found:
                each.flags.writeable = False
            while len(self._known) * 3 * torque_nm.nbytes > _KEPT_BYTES:
                self._known.popitem(last=False)
            self._known[key] = found
        self._known.move_to_end(key)
        return self._known[key]

    @functools.cached_property
    def _external_nm(self) -> np.ndarray:
        """What gravity and motion ask of the joints, between rows as on a line, shape (k, s), N m."""
        path = self._path
        rows = self._plant.load_nm(path.position, path.velocity)
        return np.stack([np.interp(path.recording.time_s, path.time_s, column) for column in rows.T])

    def cogging_image(self, state: JointState, term: Term, j: int) -> np.ndarray:
        """What cogging of the term's own phase, beside the one that the state has, adds per N m, shape (s,)."""
        return motor_law.cogging_image(state.moved(term, 0.0).motor(j), self._motions[j].position)


def _given(sent: np.ndarray | None, measured: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
    """What was sent, and what was measured beside it, shape (s, k), NaN in gaps.

    What was not sent but measured was sent so, too; a joint without any measured torque gave what was sent.
    """
    if sent is None or measured is None:
        return (sent, None) if measured is None else (measured, None)  # pyrefly: ignore[bad-return] - one of them is there
    if np.isnan(measured).all(axis=0).any():
        measured = np.where(np.isnan(measured).all(axis=0), sent, measured)
    return np.where(np.isnan(sent), measured, sent) if np.isnan(sent).any() else sent, measured
