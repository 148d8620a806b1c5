"""The one setting shared by all schemas: unknown fields and numbers that are not finite are errors, instances are frozen."""

from pydantic import BaseModel, ConfigDict


class Schema(BaseModel):
    """A message that crosses a border: validated once on entry, immutable afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
