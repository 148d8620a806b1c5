"""Errors as documents: RFC 9457 problems of the API, and what a command prints with ``--json`` when it fails."""

from typing import Any

from pydantic import BaseModel, ConfigDict

MEDIA_TYPE = "application/problem+json"


class Problem(BaseModel):
    """A problem document; ``type`` is stable, ``detail`` says what to do next. Further members depend on the type."""

    model_config = ConfigDict(extra="allow")

    type: str
    title: str
    status: int
    detail: str
    instance: str | None = None
    errors: list[dict[str, Any]] | None = None


def error_document(title: str, detail: str, exit_code: int, **more: object) -> dict[str, object]:
    """The one JSON document of a command that failed.

    Args:
        title: the kind of error in a few words.
        detail: one sentence that names the value and what to do.
        exit_code: of the process.
        more: further members, as ``type`` and ``status`` of a server's problem.
    """
    return {"error": {"title": title, "detail": detail, "exit_code": exit_code, **more}}
