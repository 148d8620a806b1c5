"""Answers with stored files: entity tags, and byte ranges for readers that look into a log without fetching it."""

from dataclasses import dataclass

from fastapi import Request, Response
from fastapi.responses import StreamingResponse

from services.errors import NotFound, ServiceError
from services.files.store import FileStore

MOST_DIGITS = 19
"""Of a number in a range; no file is longer, and Python refuses to read thousands of them."""


class RangeNotSatisfiable(ServiceError):
    """The asked range lies outside the file."""

    status = 416
    title = "Range not satisfiable"


@dataclass(frozen=True)
class Span:
    """Bytes from ``start`` up to, not including, ``end``."""

    start: int
    end: int


def requested_span(header: str | None, size: int) -> Span | None:
    """The one range of a Range header; None when the whole file is to be sent.

    Headers that are malformed, with endless numbers, in another unit or of several ranges may be ignored (RFC 9110, 14.2),
    and are.

    Raises:
        RangeNotSatisfiable: the range begins behind the end.
    """
    unit, _, spec = (header or "").partition("=")
    first, dash, last = spec.strip().partition("-")
    if (
        unit.strip().lower() != "bytes"
        or not dash
        or not all(part == "" or (part.isascii() and part.isdigit() and len(part) <= MOST_DIGITS) for part in (first, last))
    ):
        return None
    if first == "" and last == "":
        return None
    if first == "":
        start, end = max(0, size - int(last)), size
    else:
        start, end = int(first), min(size, int(last) + 1) if last else size
        if last and int(last) < start:
            return None
    if start >= size or end <= start:
        raise RangeNotSatisfiable("range-not-satisfiable", f"The file has {size} bytes; {header} lies outside.")
    return Span(start, end)


async def stored_size(files: FileStore, sha256: str) -> int:
    """Bytes of a stored file.

    Raises:
        NotFound: the file is not in the store.
    """
    size = await files.size(sha256)
    if size is None:
        raise NotFound("file-not-found", f"The file {sha256} is not in the store any more.")
    return size


async def stored_file(request: Request, files: FileStore, sha256: str, media_type: str, filename: str) -> Response:
    """The file, the asked part of it, or the word that the reader has it already.

    Raises:
        NotFound: the file is not in the store.
    """
    size = await stored_size(files, sha256)
    tag = f'"{sha256}"'
    headers = {"ETag": tag, "Accept-Ranges": "bytes", "Cache-Control": "private, immutable, max-age=31536000"}
    if _names(request.headers.get("if-none-match"), tag):
        return Response(status_code=304, headers=headers)
    current = request.headers.get("if-range") in (None, tag)
    span = requested_span(request.headers.get("range"), size) if current else None
    start, end = (0, size) if span is None else (span.start, span.end)
    headers |= {"Content-Length": str(end - start), "Content-Disposition": f'attachment; filename="{filename}"'}
    if span is not None:
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{size}"
    if request.method == "HEAD":
        return Response(status_code=200 if span is None else 206, headers=headers, media_type=media_type)
    status = 200 if span is None else 206
    return StreamingResponse(files.read(sha256, start, end), status_code=status, headers=headers, media_type=media_type)


def _names(header: str | None, tag: str) -> bool:
    return header is not None and (
        header.strip() == "*" or tag in [each.strip().removeprefix("W/") for each in header.split(",")]
    )
