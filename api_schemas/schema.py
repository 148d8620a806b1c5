"""The one setting shared by all schemas: unknown fields are an error, instances are frozen."""

from pydantic import BaseModel, ConfigDict


class Schema(BaseModel):
    """A message that crosses a border: validated once on entry, immutable afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True)
