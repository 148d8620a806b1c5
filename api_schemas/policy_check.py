"""What the server would say to an upload, told without a server."""

from api_schemas.error import Problem
from api_schemas.policy import WeightsFormat
from api_schemas.schema import Schema


class PolicyCheck(Schema):
    """The verdict on weights and a manifest; ``problem`` is what the server would answer to those that it refuses."""

    accepted: bool
    file: str
    digest: str
    weights_format: WeightsFormat | None = None
    weights_bytes: int
    warnings: tuple[str, ...] = ()
    problem: Problem | None = None
