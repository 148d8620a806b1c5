"""What a learning policy's outputs mean: numbers in [-1, 1], or one of Dactyl's eleven bins, for each joint."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from api_schemas.policy import ACTION_SIZE, ActionKind, OutputScaling, PolicyManifest
from api_schemas.policy_network import ActionHead
from sim_backend.trifinger import constants as c

BINS = 11
"""For each joint, as Dactyl discretises its actions (arXiv 1808.00177)."""
LARGEST_DELTA_RAD = 0.1
"""What an output of 1 adds to a joint's position; its stiffness of 9 N m/rad then asks for twice the largest torque."""


class ActionMode(StrEnum):
    """What an output of ±1 is."""

    TORQUE = "torque"  # ± the largest torque
    JOINT_POSITION = "joint position"  # a position between the ends of the joint's range, followed by the robot's own controller
    JOINT_DELTA = "joint delta"  # a position that far from the measured one, followed by the robot's own controller
    BINS = "dactyl bins"  # as joint delta, by the number of one of eleven bins


KINDS = {
    ActionMode.TORQUE: ActionKind.TORQUE,
    ActionMode.JOINT_POSITION: ActionKind.JOINT_POSITION,
    ActionMode.JOINT_DELTA: ActionKind.JOINT_POSITION_DELTA,
    ActionMode.BINS: ActionKind.JOINT_POSITION_DELTA,
}


@dataclass(frozen=True)
class ActionSpace:
    """How outputs become what a manifest calls an action.

    ``scale`` is what 1 stands for, N m or rad (None: the mode's own). Joint positions are counted from the middle of the range.
    """

    mode: ActionMode = ActionMode.TORQUE
    scale: float | None = None

    @property
    def largest(self) -> np.ndarray:
        """What an output of 1 stands for, shape (9,), N m or rad."""
        if self.scale is not None:
            return np.full(ACTION_SIZE, self.scale)
        if self.mode is ActionMode.JOINT_POSITION:
            return (c.SOFT_LIMIT_UPPER_RAD - c.SOFT_LIMIT_LOWER_RAD) / 2
        return np.full(ACTION_SIZE, c.MAX_TORQUE_NM if self.mode is ActionMode.TORQUE else LARGEST_DELTA_RAD)

    @property
    def middle(self) -> np.ndarray:
        """What an output of 0 stands for, shape (9,), N m or rad."""
        if self.mode is ActionMode.JOINT_POSITION:
            return (c.SOFT_LIMIT_UPPER_RAD + c.SOFT_LIMIT_LOWER_RAD) / 2
        return np.zeros(ACTION_SIZE)

    def to_command(self, action: np.ndarray) -> np.ndarray:
        """Actions of the manifest, shape (n, 9), from outputs (n, 9): clipped to [-1, 1], or numbers of bins."""
        outputs = np.asarray(action, dtype=float)
        if self.mode is ActionMode.BINS:
            outputs = 2.0 * outputs / (BINS - 1) - 1.0
        return np.clip(outputs, -1.0, 1.0) * self.largest + self.middle

    def manifest(self, layout: PolicyManifest) -> PolicyManifest:
        """The layout with these actions: what a policy trained with them is uploaded with."""
        bins, offset = self.mode is ActionMode.BINS, tuple(self.middle.tolist()) if self.middle.any() else None
        changes = {
            "action_kind": KINDS[self.mode],
            "output_scaling": OutputScaling(clip=None if bins else 1.0, scale=tuple(self.largest.tolist()), offset=offset),
            "head": ActionHead.BINS if bins else ActionHead.DIRECT,
            "bins": BINS if bins else None,
        }
        return PolicyManifest.model_validate(layout.model_dump() | changes)
