"""Identification: excitations that a robot runs, so that what it does can be measured, and the job that asks for them."""

from enum import StrEnum
from typing import Annotated

from pydantic import AfterValidator, Field

from api_schemas.schema import Schema

ANY_ROBOT = "any"
"""Instead of a robot's name: one robot for the whole job, the first that takes a trial of it."""
MAX_REPEATS = 20
MAX_EXCITATION_SEED = 2**63 - 1


class ExcitationName(StrEnum):
    """The excitations of the farm; what each commands lives in sim_backend/excitations/excitation.py."""

    SLOW_RAMPS = "slow_ramps"
    FAST_SWEEPS = "fast_sweeps"
    CHIRPS = "chirps"
    JOINT_LIMITS = "joint_limits"
    OSCILLATIONS = "oscillations"
    HOLD_POSES = "hold_poses"
    STANDARD = "standard"
    SLIDE_CUBE = "slide_cube"


def _each_once(names: tuple[ExcitationName, ...]) -> tuple[ExcitationName, ...]:
    twice = sorted({name.value for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{', '.join(twice)} is named more than once; 'repeats' runs the whole list several times")
    return names


class IdentificationRequest(Schema):
    """Body of POST /v1/identifications: each repeat runs the excitations in the given order, one trial each.

    Without a seed the server draws one.
    """

    robot: str = Field(pattern=r"^[a-z0-9-]{1,40}$", description="a robot's name, or 'any' for one that the farm chooses")
    excitations: Annotated[tuple[ExcitationName, ...], AfterValidator(_each_once)] = Field(
        default=tuple(ExcitationName), min_length=1
    )
    repeats: int = Field(default=1, ge=1, le=MAX_REPEATS)
    seed: int | None = Field(default=None, ge=0, le=MAX_EXCITATION_SEED)

    def courses(self) -> tuple[ExcitationName, ...]:
        """The excitation of each trial of the job, in their order."""
        return self.excitations * self.repeats
