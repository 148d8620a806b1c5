"""A canary: a policy whose success is known, tried on every robot from time to time so that a robot which changed is noticed."""

from pydantic import Field

from api_schemas.job import PolicyDigest, PolicyTask
from api_schemas.schema import Schema

MAX_CANARY_TRIALS = 100
SHORTEST_S = 60.0
LONGEST_S = 30 * 86_400.0


class CanaryRequest(Schema):
    """Body of PUT /v1/canary: what idle robots try every ``every_s`` seconds, and the success that a sound robot has.

    A robot whose 80 % interval of the success rate lies below ``at_least`` altogether goes out of service.
    """

    policy: PolicyDigest
    task: PolicyTask
    trials: int = Field(default=10, ge=1, le=MAX_CANARY_TRIALS)
    at_least: float = Field(gt=0.0, le=1.0, description="where the band of a sound robot's success rate begins")
    every_s: float = Field(default=86_400.0, ge=SHORTEST_S, le=LONGEST_S)


class Canary(CanaryRequest):
    """The farm's canary as the API shows it; all its jobs try the goals of one ``seed``."""

    policy_name: str
    seed: int
    set_by: str
    set_at: str
