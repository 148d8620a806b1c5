"""The HTTP application: all routes over one farm."""

from fastapi import FastAPI

from services.api import (
    history,
    identifications,
    jobs,
    leases,
    overview,
    policies,
    problems,
    robots,
    signatures,
    token_routes,
    trials,
    truth,
)
from services.api.farm import Farm


def create_app(farm: Farm) -> FastAPI:
    """The application; its routes work on the parts of ``farm``, which the caller opened and will close."""
    app = FastAPI(
        title="trifarm",
        version=farm.version,
        description="Upload a policy, ask for trials on a farm of simulated TriFingers, fetch the report and the logs.",
        # A JSON body is taken as such also when its sender forgot to say so; no browser holds these tokens.
        strict_content_type=False,
    )
    app.state.farm = farm
    problems.install(app)
    users = (overview, policies, jobs, signatures, identifications, history, trials, truth)
    for module in (*users, leases, robots, token_routes):
        app.include_router(module.router)
    return app
