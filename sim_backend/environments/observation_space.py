"""Bounds of what policies see, field by field, for learning libraries that ask for them."""

from dataclasses import dataclass

import numpy as np
from gymnasium import spaces

from api_schemas.observation import Term, term_of
from api_schemas.policy import ACTION_SIZE, PolicyManifest
from sim_backend.environments.action_space import BINS, ActionMode, ActionSpace


@dataclass(frozen=True)
class Field:
    """One observation field: meaning, bounds, unit."""

    meaning: str
    low: float
    high: float
    unit: str


FIELDS: dict[str, Field] = {
    "joint_position_rad": Field("measured positions, finger0 to finger240, base to tip", -2 * np.pi, 2 * np.pi, "rad"),
    "joint_velocity_rad_s": Field("measured velocities", -100.0, 100.0, "rad/s"),
    "joint_torque_nm": Field("measured torques", -2.0, 2.0, "N m"),
    "fingertip_position_world_m": Field("tips by the measured positions, x y z each", -1.0, 1.0, "m"),
    "cube_position_world_m": Field("newest report of the tracker", -2.0, 2.0, "m"),
    "cube_quat_wxyz": Field("newest report of the tracker", -1.0, 1.0, ""),
    "cube_keypoints_world_m": Field("corners of the cube by the newest report, x y z each", -2.0, 2.0, "m"),
    "tracker_confidence": Field("of the newest report", 0.0, 1.0, ""),
    "tracker_delay_s": Field("age of the image of the newest report", 0.0, 10.0, "s"),
    "goal_position_world_m": Field("wanted place of the cube", -1.0, 1.0, "m"),
    "goal_quat_wxyz": Field("wanted orientation of the cube", -1.0, 1.0, ""),
    "goal_keypoints_world_m": Field("wanted corners of the cube, x y z each", -1.0, 1.0, "m"),
    "goal_fingertip_position_world_m": Field("wanted tips, x y z each", -1.0, 1.0, "m"),
    "fingertip_velocity_world_m_s": Field("of the tips by the measured joints, x y z each", -20.0, 20.0, "m/s"),
    "fingertip_force": Field("of the push sensors in the tips", 0.0, 1.0, ""),
    "cube_quat_xyzw": Field("newest report of the tracker, w last", -1.0, 1.0, ""),
    "goal_quat_xyzw": Field("wanted orientation of the cube, w last", -1.0, 1.0, ""),
    "robot_id": Field("0, as in the published simulation", 0.0, 20.0, ""),
    "previous_action": Field("what was asked in the step before, as the manifest has it", -2.0, 2.0, "N m or rad"),
}
"""Bounds lie beyond what a robot shows that is in order; what lies beyond them all the same is clipped."""


def observation_space(manifest: PolicyManifest) -> spaces.Box:
    """Space of the manifest's observation, float32."""
    terms = [term_of(name) for name in manifest.observation]
    low, high = (np.concatenate([_bound(term, side) for term in terms]).astype(np.float32) for side in ("low", "high"))
    return spaces.Box(low, high, dtype=np.float32)


def _bound(term: Term, side: str) -> np.ndarray:
    return np.array(term.constant) if term.field is None else np.full(term.size, getattr(FIELDS[term.field], side))


def gym_action_space(action_space: ActionSpace) -> spaces.Box | spaces.MultiDiscrete:
    """[-1, 1] for each joint, or the number of a bin."""
    if action_space.mode is ActionMode.BINS:
        return spaces.MultiDiscrete([BINS] * ACTION_SIZE)
    return spaces.Box(-1.0, 1.0, (ACTION_SIZE,), dtype=np.float32)
