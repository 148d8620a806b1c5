"""Puts the dashboard beside the API, on the same application."""

from typing import Annotated

from fastapi import APIRouter, FastAPI, Path, Response
from fastapi.responses import FileResponse
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
    sign_in,
    studies_page,
    trial_page,
    watch_page,
)
from services.dashboard.pages import FOLDER, HEADERS
from services.dashboard.sessions import Seal
from services.errors import NotFound

router = APIRouter(include_in_schema=False)
MEDIA_TYPES = {".css": "text/css", ".js": "text/javascript", ".json": "application/json", ".svg": "image/svg+xml"}


def mount(app: FastAPI, farm: Farm) -> None:
    """Adds the pages to the API's application; sessions are sealed with the farm's key."""
    app.state.dashboard_seal = Seal.of(farm.key)
    app.state.dashboard_watcher = farm_page.Watcher()
    app.state.dashboard_streams = live.Streams()
    app.state.dashboard_watching = watch_page.Watching()
    app.state.dashboard_replays = replays.Replays(farm.settings.data / "replays")
    lists = (farm_page, jobs_page, compare_page, ladder_page, board_page, studies_page)
    for pages in (sign_in, *lists, job_page, trial_page, watch_page):
        app.include_router(pages.router)
        app.state.operations += [route for route in pages.router.routes if isinstance(route, APIRoute)]
    app.include_router(router)


@router.get("/static/{name}")
async def static(name: Annotated[str, Path(pattern=r"^[a-z_]{1,30}\.(css|js|json|svg)$")]) -> Response:
    """Our own styles and modules; browsers ask each time whether there is another, so that a new version is seen at once."""
    path = FOLDER / "static" / name
    if not path.is_file():
        raise NotFound("file-not-found", f"There is no {name} here.")
    headers = HEADERS | {"Cache-Control": "no-cache"}
    return FileResponse(path, media_type=MEDIA_TYPES[path.suffix], headers=headers)
