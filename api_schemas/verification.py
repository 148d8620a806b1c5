"""What the farm answers when it simulates a log again with what only it knows of the robot."""

from api_schemas.schema import Schema


class Verification(Schema):
    """Answer of POST /v1/jobs/{job}/trials/{ordinal}/verify.

    ``first_difference_step`` is the first millisecond whose numbers differ, null when none does. How large differences are
    is for operators only: with it, made-up logs would measure the hidden robot.
    """

    trial_id: str
    steps: int
    same: bool
    first_difference_step: int | None
    largest_joint_difference_rad: float | None = None
    largest_cube_difference_m: float | None = None
