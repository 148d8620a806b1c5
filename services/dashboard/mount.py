"""Puts the dashboard beside the API, on the same application."""

import asyncio
import functools
import gzip
from typing import Annotated

from fastapi import APIRouter, FastAPI, Path, Request, Response
from fastapi.routing import APIRoute

from services.api.farm import Farm
from services.dashboard import (
    board_page,
    compare_page,
    farm_page,
    job_page,
    jobs_page,
    ladder_page,
    live,
    replays,
    shared_page,
    sign_in,
    studies_page,
    trial_page,
    watch_page,
)
from services.dashboard.pages import FOLDER, HEADERS, not_found, takes_gzip
from services.dashboard.sessions import Seal
from services.errors import NotFound

router = APIRouter(include_in_schema=False)
Name = Annotated[str, Path(pattern=r"^[a-z_]{1,30}\.(css|js|json|svg|txt)$")]
MEDIA_TYPES = {
    ".css": "text/css",
    ".js": "text/javascript",
    ".json": "application/json",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
}


def mount(app: FastAPI, farm: Farm) -> None:
    """Adds the pages to the API's application; sessions are sealed with the farm's key."""
    app.state.dashboard_seal = Seal.of(farm.key)
    app.state.dashboard_watcher = farm_page.Watcher()
    app.state.dashboard_boards = board_page.Boards()
    app.state.dashboard_streams = live.Streams()
    app.state.dashboard_watching = watch_page.Watching()
    app.state.dashboard_openings = shared_page.openings()
    app.state.dashboard_replays = replays.Replays(farm.settings.data / "replays")
    lists = (farm_page, jobs_page, compare_page, ladder_page, board_page, studies_page)
    routers = [pages.router for pages in (sign_in, *lists, job_page, trial_page, watch_page, shared_page)]
    for each in (*routers, shared_page.anybody):
        app.include_router(each)
        app.state.operations += [route for route in each.routes if isinstance(route, APIRoute)]
    app.include_router(router)
    not_found(app)


@router.get("/static/{name}")
async def static(name: Name, request: Request) -> Response:
    """Our own styles, modules and libraries; browsers ask each time whether there is a newer one."""
    path = FOLDER / "static" / name
    if not path.is_file():
        raise NotFound("file-not-found", f"There is no {name} here.")
    plain, small, tag = await asyncio.to_thread(_kept, name, path.stat().st_mtime_ns)
    headers = HEADERS | {"Cache-Control": "no-cache", "ETag": tag, "Vary": "Accept-Encoding"}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    if takes_gzip(request):
        return Response(small, media_type=MEDIA_TYPES[path.suffix], headers=headers | {"Content-Encoding": "gzip"})
    return Response(plain, media_type=MEDIA_TYPES[path.suffix], headers=headers)


@functools.lru_cache(maxsize=32)
def _kept(name: str, changed_ns: int) -> tuple[bytes, bytes, str]:
    """A file of ours as it is and compressed, and a tag of its content; read again when it was changed."""
    plain = (FOLDER / "static" / name).read_bytes()
    return plain, gzip.compress(plain, compresslevel=9, mtime=0), f'"{changed_ns:x}-{len(plain):x}"'
