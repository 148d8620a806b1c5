"""What a learning policy's outputs mean: numbers in [-1, 1], or one of Dactyl's eleven bins, for each joint."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from api_schemas.policy import ActionKind, OutputScaling, PolicyManifest
from api_schemas.policy_network import ActionHead
from sim_backend.trifinger import constants as c

BINS = 11
"""For each joint, as Dactyl discretises its actions (arXiv 1808.00177)."""
LARGEST_DELTA_RAD = 0.1
"""What an output of 1 adds to a joint's position; its stiffness of 9 N m/rad then asks for twice the largest torque."""


class ActionMode(StrEnum):
    """What an output of ±1 is."""

    TORQUE = "torque"  # ± the largest torque
    JOINT_DELTA = "joint delta"  # a position that far from the measured one, followed by the robot's own controller
    BINS = "dactyl bins"  # as joint delta, by the number of one of eleven bins


@dataclass(frozen=True)
class ActionSpace:
    """How outputs become what a manifest calls an action; ``scale`` is what 1 stands for, N m or rad (None: the mode's own)."""

    mode: ActionMode = ActionMode.TORQUE
    scale: float | None = None

    @property
    def largest(self) -> float:
        """What an output of 1 stands for, N m or rad."""
        if self.scale is not None:
            return self.scale
        return c.MAX_TORQUE_NM if self.mode is ActionMode.TORQUE else LARGEST_DELTA_RAD

    def to_command(self, action: np.ndarray) -> np.ndarray:
        """Actions of the manifest, shape (n, 9), from outputs (n, 9): clipped to [-1, 1], or numbers of bins."""
        outputs = np.asarray(action, dtype=float)
        if self.mode is ActionMode.BINS:
            outputs = 2.0 * outputs / (BINS - 1) - 1.0
        return np.clip(outputs, -1.0, 1.0) * self.largest

    def manifest(self, layout: PolicyManifest) -> PolicyManifest:
        """The layout with these actions: what a policy trained with them is uploaded with."""
        bins = self.mode is ActionMode.BINS
        changes = {
            "action_kind": ActionKind.TORQUE if self.mode is ActionMode.TORQUE else ActionKind.JOINT_POSITION_DELTA,
            "output_scaling": OutputScaling(clip=None if bins else 1.0, scale=self.largest),
            "head": ActionHead.BINS if bins else ActionHead.DIRECT,
            "bins": BINS if bins else None,
        }
        return PolicyManifest.model_validate(layout.model_dump() | changes)
