"""Shares: one report, or a moment of one trial, for whoever has a link and no token."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from api_schemas.job import JobId
from api_schemas.schema import Schema

USUAL_DAYS, MOST_DAYS = 7.0, 90.0
LATEST_S = 10_000.0
"""Later than the end of any trial."""
TrialId = Annotated[str, Field(pattern=r"^j[a-z2-7]{12}-[0-9]{3,5}$", description="a trial")]


class ShareRequest(Schema):
    """Body of POST /v1/shares: a job, whose report is shared, or a trial with perhaps a moment of it."""

    job: JobId | None = None
    trial: TrialId | None = None
    at_s: float | None = Field(default=None, ge=0, le=LATEST_S, description="the moment at which the trial's replay opens")
    days: float = Field(default=USUAL_DAYS, gt=0, le=MOST_DAYS, description="after so many the link leads nowhere")

    @model_validator(mode="after")
    def _one_thing(self) -> Self:
        if (self.job is None) == (self.trial is None):
            raise ValueError("name either a job, whose report is shared, or a trial")
        if self.at_s is not None and self.trial is None:
            raise ValueError("a report has no moments; name a trial")
        return self


class Share(Schema):
    """What is shared until when; ``trial_id`` is null for a report. The link itself is shown once, when it is made."""

    share_id: str
    job_id: str
    trial_id: str | None
    at_s: float | None
    owner: str
    created_at: str
    expires_at: str
    revoked_at: str | None
    is_open: bool


class NewShare(Share):
    """A share just made; ``url`` is the link, which is never shown again."""

    url: str


class SharePage(Schema):
    """One page of shares, newest first; ``next_cursor`` is null on the last page."""

    shares: tuple[Share, ...]
    next_cursor: str | None = None
