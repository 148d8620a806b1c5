"""The object between a robot's fingers; its shape, mass and inertia live in sim_backend/trifinger/objects.py."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

SMALLEST_SCALE = 0.6
LARGEST_SCALE = 1.2


class ObjectName(StrEnum):
    """The objects of the farm. Goals and keypoints are those of the cube for every one."""

    CUBE = "cube"
    CUBOID = "cuboid"
    SPHERE = "sphere"
    OCTAGONAL_PRISM = "octagonal_prism"


ObjectScale = Annotated[float, Field(ge=SMALLEST_SCALE, le=LARGEST_SCALE, description="times the object's usual size")]
