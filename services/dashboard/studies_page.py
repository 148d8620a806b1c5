"""The reality gap's reports: whatever studies an operator puts into a folder, shown without trusting a byte of them."""

import asyncio
import os
import re
import stat
from dataclasses import dataclass
from datetime import UTC, datetime
from html import unescape
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Response
from fastapi import Path as InPath
from fastapi.responses import HTMLResponse

from services.api.farm import Farm, TheFarm
from services.dashboard.pages import HEADERS, PageRoute, page
from services.dashboard.sessions import SignedIn
from services.errors import NotFound

router = APIRouter(route_class=PageRoute, include_in_schema=False)
FOLDER = "studies"
REPORT = "report.html"
NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,79}$"
MOST_BYTES = 20 * 1024**2
MOST_LISTED = 200
TITLE = re.compile(r"<title>([^<]{1,200})</title>")
HEAD_BYTES = 4096
SHUT_IN = {
    # An origin of its own, in which no script runs and no form is sent: a report cannot act as the farm's page.
    "Content-Security-Policy": "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
}


@dataclass(frozen=True)
class Study:
    """A report in the folder."""

    name: str
    title: str
    written_at: str


def folder_of(farm: Farm) -> Path:
    """Where operators put studies."""
    return farm.settings.studies or farm.settings.data / FOLDER


@router.get("/studies")
async def show_studies(session: SignedIn, farm: TheFarm) -> Response:
    """The list, newest first."""
    found = await asyncio.to_thread(studies, folder_of(farm))
    return page("studies.html", session, title="Reality gap", here="studies", studies=found)


@router.get("/studies/{name}")
async def show_study(name: Annotated[str, InPath(pattern=NAME)], _session: SignedIn, farm: TheFarm) -> Response:
    """The report itself, shut in."""
    body = await asyncio.to_thread(report, folder_of(farm), name)
    if body is None:
        raise NotFound("study-not-found", f"There is no study {name}; the page of studies lists those that there are.")
    return HTMLResponse(body, headers=HEADERS | SHUT_IN)


def studies(folder: Path) -> list[Study]:
    """The studies of a folder: each a folder of its own with the report that ``trifarm gap study --out`` wrote."""
    names = [each.name for each in folder.iterdir() if re.fullmatch(NAME, each.name)] if folder.is_dir() else []
    dated = [(at_s, name) for name in names if (at_s := _written_s(folder, name)) is not None]
    found = []
    for at_s, name in sorted(dated, reverse=True)[:MOST_LISTED]:
        body = report(folder, name, HEAD_BYTES)
        if body is not None:
            title = TITLE.search(body.decode(errors="replace"))
            written_at = datetime.fromtimestamp(at_s, UTC).isoformat()
            found.append(Study(name, unescape(title[1]).strip() if title else name, written_at))
    return found


def _written_s(folder: Path, name: str) -> float | None:
    """When a study's report was written last, without opening it; None where there is none, also not any more."""
    try:
        known = (folder / name / REPORT).lstat()
    except OSError:
        return None
    return known.st_mtime if stat.S_ISREG(known.st_mode) else None


def report(folder: Path, name: str, most: int = MOST_BYTES) -> bytes | None:
    """The first bytes of a study's report; None where there is none, or where it is a link, no file or too large."""
    try:
        with os.fdopen(os.open(folder / name / REPORT, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            known = os.fstat(file.fileno())
            return file.read(most) if stat.S_ISREG(known.st_mode) and known.st_size <= MOST_BYTES else None
    except OSError:
        return None
