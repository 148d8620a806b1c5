"""How the farm is, in plain words."""

from pydantic import Field

from api_schemas.jail_report import JailReport
from api_schemas.schema import Schema


class FarmStatus(Schema):
    """Body of GET /v1/status. ``healthy`` is false when ``problems`` has entries."""

    healthy: bool
    summary: str
    problems: tuple[str, ...]
    robots_by_state: dict[str, int]
    jobs_by_state: dict[str, int]
    trials_queued: int
    trials_running: int
    oldest_queued_s: float | None
    version: str
    farm: str
    physics: str
    jail: JailReport | None = Field(default=None, description="what conversions and verifications are put into")
    services_since: str | None = Field(default=None, description="when the services that answer started, in ISO 8601")
    robots_by_jail: dict[str, int] = Field(default={}, description="robots by the level of their policies' jail")
