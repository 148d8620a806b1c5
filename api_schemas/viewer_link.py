"""A link by which a viewer reads one file for some minutes without a token."""

from pydantic import Field

from api_schemas.schema import Schema


class ViewerLink(Schema):
    """Answer of POST /v1/trials/{trial_id}/link: whoever has ``url`` can read this one log until ``expires_at``."""

    trial_id: str
    url: str
    expires_at: str
    lasts_s: int = Field(description="from when it was made")
