"""The page of one trial: replayed in three dimensions from its log, beside what was measured, with one time for all."""

from typing import Annotated, Any, Literal
from urllib.parse import quote

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import RedirectResponse

from api_schemas.token import Scope
from api_schemas.trial import AttemptState, Trial, TrialState
from services.api import jobs, trials, whys
from services.api.farm import Farm, TheFarm
from services.api.links import linked
from services.api.trials import TrialId
from services.dashboard.job_page import FAILED_BY_PLATFORM
from services.dashboard.pages import HEADERS, PageRoute, page
from services.dashboard.replays import TheReplays, sent
from services.dashboard.sessions import Session, SignedIn, refuse_foreign
from services.errors import NotFound
from services.jobs.lists import trial_row

router = APIRouter(route_class=PageRoute, include_in_schema=False)
Viewer = Literal["foxglove", "lichtblick", "rerun"]


@router.get("/trials/{trial_id}")
async def show_trial(
    trial_id: TrialId, session: SignedIn, farm: TheFarm, beside: Annotated[TrialId | None, Query(alias="with")] = None
) -> Response:
    """The page; what is drawn comes after it. ``with`` names another trial to be shown beside it, in the same time."""
    shown = await trials.get_trial(trial_id, session.caller, farm)
    other = None if beside is None else await trials.get_trial(beside, session.caller, farm)
    job = await jobs.get_job(shown.job_id, session.caller, farm)
    title = f"Trial {shown.ordinal} of {job.policy_name or 'an identification'}"
    neighbours = (shown.ordinal - 1 if shown.ordinal else None, shown.ordinal + 1 if shown.ordinal + 1 < job.trials else None)
    context: dict[str, Any] = {"trial": shown, "job": job, "neighbours": neighbours, "sees_truth": _sees_truth(session, shown)}
    context["other"] = other if other is not None and other.log_sha256 is not None else None
    context["other_job"] = None if other is None else await jobs.get_job(other.job_id, session.caller, farm)
    context["viewers"] = viewers(farm)
    context["shares"] = farm.settings.shares
    context["why"] = await whys.sentence_of(shown, session.caller, farm)
    faulted = shown.state is TrialState.CANCELLED and any(each.state is AttemptState.PLATFORM_FAULT for each in shown.attempts)
    context["shown"] = shown.outcome.kind if shown.outcome else FAILED_BY_PLATFORM if faulted else shown.state
    context["runs"] = shown.state in {TrialState.LEASED, TrialState.RUNNING}
    return page("trial.html", session, title=title, here="jobs", **context)


def _sees_truth(session: Session, shown: Trial) -> bool:
    return shown.has_truth and session.caller.may(Scope.OPERATE)


@router.get("/trials/{trial_id}/replay")
async def get_replay(trial_id: TrialId, request: Request, session: SignedIn, farm: TheFarm, replays: TheReplays) -> Response:
    """What is drawn of a trial; its truth only for those who may see it."""
    shown = await trials.get_trial(trial_id, session.caller, farm)
    if shown.log_sha256 is None:
        raise NotFound("log-not-found", f"Trial {trial_id} is {shown.state} and has no log; logs come with accepted outcomes.")
    truth = None
    if _sees_truth(session, shown):
        async with farm.database.read() as connection:
            row = await trial_row(connection, trial_id)
        truth = None if row is None else row.truth_sha256
    return await sent(await replays.reduced(farm, session.caller.owner, shown.log_sha256, truth), request)


@router.get("/trials/{trial_id}/images")
async def get_images(trial_id: TrialId, request: Request, session: SignedIn, farm: TheFarm, replays: TheReplays) -> Response:
    """What the cameras of a trial saw, where its log has that."""
    shown = await trials.get_trial(trial_id, session.caller, farm)
    if shown.log_sha256 is None:
        raise NotFound("log-not-found", f"Trial {trial_id} is {shown.state} and has no log; logs come with accepted outcomes.")
    return await sent(await replays.images(farm, session.caller.owner, shown.log_sha256), request)


@router.get("/trials/{trial_id}/open/{viewer}")
async def open_in(trial_id: TrialId, viewer: Viewer, request: Request, session: SignedIn, farm: TheFarm) -> Response:
    """Leads to a viewer with a link to the log, which that site's pages can then read for ten minutes."""
    refuse_foreign(request)
    leads_to = viewers(farm).get(viewer)
    if leads_to is None:
        raise NotFound("viewer-not-offered", f"This farm does not open logs in {viewer}; its operator can name an address.")
    link = linked(await trials.get_trial(trial_id, session.caller, farm), session.caller, farm)
    address = str(request.base_url).rstrip("/") + link.path(farm)
    return RedirectResponse(leads_to + quote(address, safe=""), status_code=303, headers=HEADERS)


def viewers(farm: Farm) -> dict[str, str]:
    """The viewers that are offered, each with the address that a link is put behind."""
    known = {"foxglove": farm.settings.foxglove_url, "lichtblick": farm.settings.lichtblick_url, "rerun": farm.settings.rerun_url}
    return {name: address for name, address in known.items() if address}


@router.get("/trials/{trial_id}/log")
async def get_log(trial_id: TrialId, request: Request, session: SignedIn, farm: TheFarm) -> Response:
    """The log itself, as the API serves it, but not for whoever uses this browser next."""
    answer = await trials.get_log(trial_id, request, session.caller, farm)
    answer.headers.update(HEADERS)
    return answer
