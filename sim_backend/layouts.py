"""What policies that are trained here may see: the farm's ready-made layouts, and some made for training."""

from api_schemas.policy import LAYOUTS, PolicyManifest

_ROBOT = ("joint_position_rad", "joint_velocity_rad_s", "fingertip_position_world_m")
_CUBE = ("cube_keypoints_world_m", "tracker_delay_s")
TRAINING_LAYOUTS: dict[str, PolicyManifest] = LAYOUTS | {
    "reach": PolicyManifest(
        name="reach",
        observation=(
            *_ROBOT,
            "goal_fingertip_position_world_m",
            "previous_action",
        ),
    ),
    "push": PolicyManifest(
        name="push",
        observation=(
            *_ROBOT,
            *_CUBE,
            "goal_position_world_m",
            "previous_action",
        ),
    ),
    "move": PolicyManifest(
        name="move",
        observation=(
            *_ROBOT,
            *_CUBE,
            "goal_keypoints_world_m",
            "previous_action",
        ),
    ),
    "move-pose": PolicyManifest(
        name="move-pose",
        observation=(
            *_ROBOT,
            "cube_position_world_m",
            "cube_quat_wxyz",
            "tracker_delay_s",
            "goal_position_world_m",
            "goal_quat_wxyz",
            "previous_action",
        ),
    ),
}
"""By name. The last four show the fingertips, too; ``push`` is for goals without an orientation, ``move`` for any pose, and
``move-pose`` for any pose by position and quaternion instead of corners."""


def layout_of(name: str) -> PolicyManifest:
    """A layout by its name.

    Raises:
        ValueError: there is none of this name.
    """
    if name not in TRAINING_LAYOUTS:
        raise ValueError(f"unknown layout {name!r}; choose from {', '.join(TRAINING_LAYOUTS)}")
    return TRAINING_LAYOUTS[name]
