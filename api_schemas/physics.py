"""Names and limits of the simulated world that programs share: physics, objects, what a robot can be asked for."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pydantic import Field

NOMINAL = "nominal"
NAMED_PHYSICS = (NOMINAL, "mild", "real", "real-images", "real-2")
"""The physics that every farm has; anything else is a file."""
FILE_PREFIX = "file:"


def physics_name(given: str) -> str:
    """The name under which physics is shown: itself if the farm has it, otherwise ``file:`` and the file's stem."""
    if given in NAMED_PHYSICS or given.startswith(FILE_PREFIX):
        return given
    return f"{FILE_PREFIX}{Path(given).stem}"


SMALLEST_SCALE = 0.6
LARGEST_SCALE = 1.2


class ObjectName(StrEnum):
    """The objects of the farm. Goals and keypoints are those of the cube for every one."""

    CUBE = "cube"
    CUBOID = "cuboid"
    SPHERE = "sphere"
    OCTAGONAL_PRISM = "octagonal_prism"


ObjectScale = Annotated[float, Field(ge=SMALLEST_SCALE, le=LARGEST_SCALE, description="times the object's usual size")]


MAX_TORQUE_NM = 0.396
"""Of each motor, at its joint; the driver clips what is asked beyond it."""
SOFT_LIMIT_LOWER_RAD = (-0.33, 0.0, -2.7) * 3
SOFT_LIMIT_UPPER_RAD = (1.0, 1.57, 0.0) * 3
"""Where the driver turns each joint back, finger by finger."""
