"""The HTTP application: all routes over one farm."""

from collections import Counter

from fastapi import FastAPI
from fastapi.routing import APIRoute
from prometheus_client import Counter as PromCounter

from services.api import (
    canary,
    document,
    history,
    identifications,
    jobs,
    joining,
    ladders,
    leaderboards,
    leases,
    links,
    metrics,
    overview,
    policies,
    problems,
    robots,
    shares,
    signatures,
    token_routes,
    trials,
    truth,
    whys,
)
from services.api.door import Door
from services.api.farm import Farm
from services.api.rate_limits import Limits
from services.turns import Turns


def create_app(farm: Farm) -> FastAPI:
    """The application; its routes work on the parts of ``farm``, which the caller opened and will close."""
    app = FastAPI(
        title="trifarm",
        version=farm.version,
        description="Upload a policy, ask for trials on a farm of simulated TriFingers, fetch the report and the logs.",
        # A JSON body is taken as such also when its sender forgot to say so; no browser holds these tokens.
        strict_content_type=False,
        # Their pages would run a script of another site in the origin of the dashboard's sessions.
        docs_url=None,
        redoc_url=None,
    )
    app.state.farm, app.state.operations = farm, []
    app.state.link_readers, app.state.event_readers = Counter(), Counter()
    app.state.uploads, app.state.verified = Counter(), Counter()
    app.state.lists = Turns()
    problems.install(app)
    document.install(app)
    app.state.limits = Limits.of(farm.settings)
    told = PromCounter("trifarm_problems", "Answers that are a problem, by its type", ["type"], registry=farm.registry)
    app.add_middleware(Door, settings=farm.settings, tokens=farm.tokens, limits=app.state.limits, problems=told)
    users = (
        *(overview, metrics, policies, jobs, ladders, leaderboards, signatures, identifications, history),
        *(trials, links, shares, truth, whys),
    )
    # Routes are looked through in this order, and robots ask most often.
    for module in (leases, *users, robots, canary, joining, token_routes):
        app.include_router(module.router)
        app.state.operations += [route for route in module.router.routes if isinstance(route, APIRoute)]
    return app
