"""What pushes are replayed with: a robot, its cube and its tracker as far as they are known.

What a replay tries is beside what is known: a factor of a value that the base has, or an error of the tracker on top of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.physics import Physics
from sim_backend.reality_gap.knowledge.cube import DELAY, ENCODER_OFFSET, OFFSET, PUSHED, REPLAYED, SCALE, SIZE, Trial
from sim_backend.reality_gap.recording import Recording
from sim_backend.trifinger import constants as c


@dataclass(frozen=True)
class ReplayedRobot:
    """A robot as far as it is known.

    Attributes:
        physics: of its joints, cube and contacts (n = 1), without what sensors make of them.
        encoder_offset_rad: what its encoders show too much, shape (9,).
        delay_s: how late torques act at each joint, shape (9,).
        bias_m: where the tracker sees the cube too far, shape (3,).
        scale: by what share of its distance from the origin.
    """

    physics: Physics = field(default_factory=Physics.nominal)
    encoder_offset_rad: np.ndarray = field(default_factory=lambda: np.zeros(9))
    delay_s: np.ndarray = field(default_factory=lambda: np.zeros(9))
    bias_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    scale: float = 0.0

    @classmethod
    def of(cls, found: Physics) -> "ReplayedRobot":
        """The base of what was found of a robot's joints (n = 1).

        Of chance, heat and filters nothing is replayed: windows are short, and begin at any temperature.
        """
        kept = {key: values for key, values in found.given.items() if key.partition(".")[0] in REPLAYED}
        return cls(Physics(1, kept), found.value(ENCODER_OFFSET)[0].copy(), found.value(DELAY)[0].copy())

    @property
    def is_nominal(self) -> bool:
        """Whether nothing is known."""
        return self.physics.is_nominal and not (
            self.encoder_offset_rad.any() or self.delay_s.any() or self.bias_m.any() or self.scale
        )

    def tried(self, trial: Trial) -> Physics:
        """The physics with a trial's factors on top, within the catalogue's bounds."""
        return self.physics.changed({key: _allowed(key, self.physics.value(key) * f) for key, f in trial.physics.items()})

    def values(self, effect: str) -> np.ndarray:
        """The numbers of an effect that pushes show, shape (n,)."""
        if effect == OFFSET:
            return self.bias_m
        return np.array([self.scale]) if effect == SCALE else self.physics.value(PUSHED[effect])

    def unit_of(self, effect: str) -> float:
        """What one unit of a hypothesis' numbers is of the effect's: factors are of what the base has."""
        return 1.0 if effect in (OFFSET, SCALE) else float(self.values(effect)[0])

    def moved(self, effect: str, moves: Sequence[float]) -> "ReplayedRobot":
        """The same with other numbers of an effect: by how much more in a hypothesis' units, within the catalogue's bounds."""
        return self.with_values(effect, self.values(effect) + self.unit_of(effect) * np.asarray(moves))

    def without(self, effect: str) -> "ReplayedRobot":
        """The same without an effect that pushes show."""
        return self.with_values(effect, absent_values(effect))

    def with_values(self, effect: str, values: np.ndarray) -> "ReplayedRobot":
        """The same with numbers, shape (n,), of an effect that pushes show, within the catalogue's bounds."""
        kept = _allowed(PUSHED[effect], values)
        if effect == OFFSET:
            return replace(self, bias_m=kept)
        if effect == SCALE:
            return replace(self, scale=float(kept[0]))
        return replace(self, physics=self.physics.changed({PUSHED[effect]: kept}))

    def place_m(self, trial: Trial, seen_m: np.ndarray) -> np.ndarray:
        """Where cubes are that the tracker sees at ``seen_m``, shape (n, 2)."""
        return (seen_m - self.bias_m[:2] - trial.bias_m) / (1.0 + self.scale + trial.scale)

    def seen_m(self, trial: Trial, place_m: np.ndarray) -> np.ndarray:
        """Where the tracker sees cubes that are at ``place_m``, shape (n, 2)."""
        return place_m * (1.0 + self.scale + trial.scale) + self.bias_m[:2] + trial.bias_m

    @property
    def rest_height_m(self) -> float:
        """Where the tracker sees a cube that rests on a face, beyond where a nominal one is."""
        true_m = c.CUBE_REST_HEIGHT_M * float(self.values(SIZE)[0])
        return true_m * (1.0 + self.scale) + float(self.bias_m[2]) - c.CUBE_REST_HEIGHT_M

    def as_it_was(self, recordings: Sequence[Recording]) -> list[Recording]:
        """Recordings with joints where they were, not where encoders show them, and torques when they acted, not when sent."""
        if not (self.encoder_offset_rad.any() or self.delay_s.any()):
            return list(recordings)
        return [self._as_it_was(recording) for recording in recordings]

    def _as_it_was(self, recording: Recording) -> Recording:
        joints = recording.joints
        if joints is None or joints.position_rad.shape[1] != len(self.encoder_offset_rad):
            return recording
        position, torque = joints.position_rad - self.encoder_offset_rad, joints.commanded_torque_nm
        if torque is not None:
            torque = _late(torque, self.delay_s / recording.step_s)
        return replace(recording, joints=replace(joints, position_rad=position, commanded_torque_nm=torque))


NOMINAL_ROBOT = ReplayedRobot()


def absent_values(effect: str) -> np.ndarray:
    """The numbers of an effect that pushes show where it is absent, shape (n,)."""
    parameter = PARAMETERS[PUSHED[effect]]
    return np.full(parameter.width, parameter.absent)


def _allowed(key: str, values: np.ndarray) -> np.ndarray:
    return np.clip(values, PARAMETERS[key].lower, PARAMETERS[key].upper)


def _late(torque_nm: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Torques (s, k), each so many steps later (k,), a part of a step as a mean of two; the first ones stay until then."""
    whole = steps.astype(int)
    rows, joints = np.arange(len(torque_nm))[:, None], np.arange(len(steps))
    earlier, later = (torque_nm[np.maximum(rows - back, 0), joints] for back in (whole + 1, whole))
    return (steps - whole) * earlier + (1.0 - (steps - whole)) * later
