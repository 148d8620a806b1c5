"""Policies that come with the farm and need no weights; operators alone may queue jobs of them."""

import hashlib

from api_schemas.builtin_mark import BUILTIN_MARK
from api_schemas.policy import ActionKind, PolicyManifest, policy_digest

PREFIX = "builtin:"
"""Before a built-in policy's name where a policy's file or digest is asked for, as in ``builtin:grasp``."""

GRASP = PolicyManifest(
    name="builtin-grasp",
    observation=(
        "joint_position_rad",
        "cube_position_world_m",
        "cube_quat_wxyz",
        "tracker_delay_s",
        "goal_position_world_m",
    ),
    action_kind=ActionKind.JOINT_POSITION,
)
GRASP_TURN = GRASP.model_copy(
    update={"name": "builtin-grasp-turn", "observation": (*GRASP.observation, "goal_quat_wxyz")},
)
BUILTIN: dict[str, PolicyManifest] = {"grasp": GRASP, "grasp-turn": GRASP_TURN}
VERSION = 1
"""To be raised whenever a built-in policy acts otherwise than before, so that its results are not counted with earlier ones."""


def builtin_manifest(text: str) -> PolicyManifest | None:
    """What the policy sees and does that a text as ``builtin:grasp`` names; None if it names none."""
    return BUILTIN.get(text.removeprefix(PREFIX)) if text.startswith(PREFIX) else None


def builtin_content(name: str) -> bytes:
    """What stands for the weights of a built-in policy."""
    return BUILTIN_MARK + f"{name}, version {VERSION}\n".encode()


def builtin_digest(name: str) -> str:
    """The digest under which the farm keeps a built-in policy."""
    return policy_digest(hashlib.sha256(builtin_content(name)).hexdigest(), BUILTIN[name])


BUILTIN_NAMES: dict[str, str] = {builtin_digest(name): name for name in BUILTIN}
"""By digest."""
