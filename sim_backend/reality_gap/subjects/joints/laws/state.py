"""The model of k joints that a study has come to so far: values of effects by "effect.parameter"."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.effects.effect import Scope
from sim_backend.reality_gap.knowledge.joint_effects import TORQUE_CONSTANT
from sim_backend.reality_gap.knowledge.unnamed_laws import BEARING, BRAKING, DRAG, LINK_CENTRES, LINK_INERTIA, ZERO
from sim_backend.reality_gap.subjects.joints.laws.motor_law import VECTOR, absent_values

CLOCK = "clock.offset_s"
"""Not an effect but what nobody can know of a recording: when within a sample the torque acted that was written there."""
SENSED = "sensed.share"
"""Nor is this: which share of the difference between measured and sent torque is noise of the sensor, for each joint."""
_SCALE_OF_TORQUE = (-0.55, 1.2)
"""Errors of a motor's constant of anybody's robot: a torque of half or twice its size is no other unit yet, and no cause else."""
NO_EFFECTS = frozenset({CLOCK, SENSED, LINK_INERTIA, *LINK_CENTRES, ZERO, DRAG, BRAKING, *BEARING})


@dataclass(frozen=True)
class Term:
    """One number that a study may move: parameter, index of joint or axis, and how its image is probed.

    Attributes:
        key: "effect.parameter".
        index: of the joint or axis; 0 for a global parameter.
        probe: change of the value that the image is taken with, in the parameter's unit.
        shape: values of the effect's shape parameters that go with it.
    """

    key: str
    index: int
    probe: float
    shape: tuple[tuple[str, float], ...] = ()

    @property
    def effect(self) -> str:
        """Name in the catalogue."""
        return self.key.partition(".")[0]


@dataclass(frozen=True)
class JointState:
    """Values that differ from absent; shape (k,) for parameters of joints, (1,) or (3,) for others.

    ``size`` is this robot's largest torque in units of a TriFinger's, ``inertia_size`` the largest inertia of its joints in the
    same way: what the catalogue bounds in N m and in kg m^2 goes with them.
    """

    joints: int
    given: Mapping[str, np.ndarray] = field(default_factory=dict)
    size: float = 1.0
    inertia_size: float = 1.0

    def size_of(self, key: str) -> float:
        """How much larger a parameter may be in this robot than in a TriFinger: as its torques, its inertias, or as large."""
        unit = PARAMETERS[key].unit
        return self.size if unit.startswith("N m") else self.inertia_size if unit.startswith("kg m") else 1.0

    def value(self, key: str) -> np.ndarray:
        """Values of a parameter, absent where none was given."""
        if key in self.given:
            return self.given[key]
        return np.full(self.width(key), absent_of(key))

    def width(self, key: str) -> int:
        """How many values a parameter has."""
        if key in NO_EFFECTS:
            return 1 if key == CLOCK else self.joints
        scope = PARAMETERS[key].scope
        return self.joints if scope is Scope.JOINT else PARAMETERS[key].width

    def bounds(self, key: str) -> tuple[float, float]:
        """The catalogue's bounds of a parameter, for a robot of this size; of a torque's scale up to what a wrong unit makes."""
        if key == TORQUE_CONSTANT:
            return _SCALE_OF_TORQUE
        parameter = PARAMETERS[key]
        by = self.size_of(key)
        return parameter.lower * min(by, 1.0) if parameter.lower > 0.0 else parameter.lower * by, parameter.upper * by

    def moved(self, term: Term, by: float, *, with_shape: bool = True) -> "JointState":
        """The state with one number changed by an amount, and its shape parameters set."""
        changed = dict(self.given)
        values = self.value(term.key).copy()
        values[term.index] += by
        changed[term.key] = values
        if with_shape:
            for key, value in term.shape:
                shaped = self.value(key).copy()
                shaped[term.index if len(shaped) > 1 else 0] = value
                changed[key] = shaped
        return replace(self, given=changed)

    def with_values(self, values: Mapping[tuple[str, int], float]) -> "JointState":
        """The state with some values instead of its own, by parameter and index."""
        changed = dict(self.given)
        for (key, index), value in values.items():
            own = np.array(changed.get(key, self.value(key)), dtype=float)
            own[index] = value
            changed[key] = own
        return replace(self, given=changed)

    def motor(self, joint: int) -> np.ndarray:
        """One joint's values for the motor law."""
        return self.motors()[joint]

    def motors(self) -> np.ndarray:
        """Values of all joints for the motor law, shape (k, p)."""
        values = np.tile(absent_values(), (self.joints, 1))
        for i, key in enumerate(VECTOR):
            if key in self.given:
                values[:, i] = self.given[key]  # one value is that of all joints
        return values


def absent_of(key: str) -> float:
    """The value of a parameter that was not given."""
    return 0.0 if key in NO_EFFECTS else PARAMETERS[key].absent


def values_of(states: Sequence[JointState], key: str) -> np.ndarray:
    """Values of a parameter in some models, a row for each."""
    if any(key in state.given for state in states):
        return np.array([state.value(key) for state in states])
    return np.full((len(states), states[0].width(key)), absent_of(key))
