"""A small real HTTP server that answers the client with api_schemas bodies, over a socket, like the services do."""

import asyncio
import hashlib
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import uvicorn
from fastapi import FastAPI, Form, Header, Request, UploadFile
from fastapi.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse

from api_schemas.builtin_policies import builtin_digest
from api_schemas.canary import Canary, CanaryRequest
from api_schemas.error import MEDIA_TYPE, Problem
from api_schemas.excitation import IdentificationRequest
from api_schemas.job import Job, JobEvent, JobLabels, JobPage, JobRequest, JobState, TaskName
from api_schemas.ladder import Ladder, LadderRequest, Rung
from api_schemas.policy import LAYOUTS, Policy, PolicyManifest, WeightsFormat, policy_digest
from api_schemas.robot import Robot, RobotPage, RobotState
from api_schemas.share import NewShare, Share, SharePage, ShareRequest
from api_schemas.status import FarmStatus
from api_schemas.token import NewToken, Token, TokenPage, TokenRequest
from api_schemas.trial import Trial, TrialPage, TrialState, Verification

TOKEN = "trifarm_test_secret"
JOB_ID = "jabcdefghijkl"
LADDER_ID = "labcdefghijkl"
AT = "2026-01-02T03:04:05+00:00"


@dataclass
class FarmState:
    """What the server answers with; a test changes it and reads what the client asked."""

    state: JobState = JobState.SUCCEEDED
    trials: int = 3
    logs: dict[str, bytes] = field(default_factory=dict)
    report: bytes = b'{"job_id": "jabcdefghijkl",  "trials": 3}'
    reports: dict[str, bytes] = field(default_factory=dict)
    problem: Problem | None = None
    streams: list[list[JobEvent | None]] = field(default_factory=list)
    last_event_ids: list[str | None] = field(default_factory=list)
    ranges: list[str | None] = field(default_factory=list)
    log_cuts: list[int] = field(default_factory=list)
    submissions: list[tuple[JobRequest, str | None]] = field(default_factory=list)
    uploads: list[str] = field(default_factory=list)
    ladders: list[tuple[LadderRequest, str | None]] = field(default_factory=list)
    ladder_looks: int = 0
    canaries: list[CanaryRequest] = field(default_factory=list)
    warnings: tuple[str, ...] = ()
    hang_stream: bool = False
    post_answers_lost: int = 0
    busy: dict[str, int] = field(default_factory=dict)
    commands: list[str] = field(default_factory=list)
    truths: dict[int, bytes] = field(default_factory=dict)
    truths_for_all: bool = True
    identifications: list[tuple[IdentificationRequest, str | None]] = field(default_factory=list)
    verdict: Verification | None = None
    verified: list[tuple[str, bytes]] = field(default_factory=list)
    task: TaskName = TaskName.PUSH


def job(farm: FarmState, **changes: object) -> Job:
    ended = farm.state in {JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED}
    return Job(
        job_id=JOB_ID, state=farm.state, waiting_because=None if ended else "no robot is in service", policy="0" * 64,
        policy_name="expert", task=farm.task, trials=farm.trials, seed=7, seed_drawn_by_server=False, owner="operator",
        created_at=AT, started_at=AT, ended_at=AT if ended else None,
        trials_done=farm.trials if ended else 0, trials_running=0, successes=2 if ended else 0,
        policy_faults=0, platform_faults=0, reason="robot-1 vanished 5 times" if farm.state is JobState.FAILED else None,
    ).model_copy(update=changes)  # fmt: skip


def trial(farm: FarmState, ordinal: int, log: bytes | None) -> Trial:
    return Trial(
        trial_id=f"{JOB_ID}-{ordinal:03d}", job_id=JOB_ID, ordinal=ordinal, state=TrialState.DONE, waiting_because=None,
        task="push", seed=ordinal, robot="robot-0", robot_order=("robot-0",), outcome=None, attempts=(),
        log_sha256=None if log is None else hashlib.sha256(log).hexdigest(), log_bytes=None if log is None else len(log),
        has_truth=ordinal in farm.truths,
    )  # fmt: skip


def ladder(farm: FarmState) -> Ladder:
    """The last one that was asked for; its jobs have ended when it was looked at so often as was said."""
    request, _ = farm.ladders[-1]
    state = JobState.RUNNING if farm.ladder_looks else JobState.SUCCEEDED
    farm.ladder_looks = max(0, farm.ladder_looks - 1)
    rungs = tuple(
        Rung(
            step=rung.step, job_id=JOB_ID, state=state, policy=rung.policy, policy_name="expert", trials=request.trials,
            trials_done=2, successes=1, success_rate=0.5, interval_80=(0.2, 0.8), interval_95=(0.1, 0.9),
        )
        for rung in request.rungs
    )  # fmt: skip
    return Ladder(
        ladder_id=LADDER_ID, name=request.name, owner="operator", created_at=AT, task=request.task, object=request.object,
        object_scale=request.object_scale, trials=request.trials, seed=7, seed_drawn_by_server=request.seed is None, rungs=rungs,
    )  # fmt: skip


def canary(request: CanaryRequest) -> Canary:
    return Canary(**request.model_dump(), policy_name="expert", seed=7, set_by="operator", set_at=AT)


def event(number: int, kind: str, *, ordinal: int | None = None, done: int = 0, state: JobState = JobState.RUNNING) -> JobEvent:
    return JobEvent(
        id=number, job_id=JOB_ID, at=f"2026-01-02T03:04:{number:02d}+00:00", kind=kind, trial_ordinal=ordinal,
        robot=None if ordinal is None else f"robot-{ordinal}", text=kind,
        trials_done=done, trials=3, successes=done, state=state,
    )  # fmt: skip


ROBOT = Robot(robot="robot-0", state=RobotState.LOST, pid=None, host=None, trial=None, reason="no sign of life since 3 s")
STATUS = FarmStatus(
    healthy=False, summary="1 of 4 robots is lost", problems=("robot-0 is lost",), robots_by_state={"idle": 3, "lost": 1},
    jobs_by_state={"queued": 2, "failed": 0}, trials_queued=80, trials_running=3, oldest_queued_s=300.0, version="0.1.0",
    farm="farm", physics="nominal",
)  # fmt: skip
SHARE = Share(
    share_id="s1",
    job_id=JOB_ID,
    trial_id=None,
    at_s=None,
    owner="ann",
    created_at=AT,
    expires_at=AT,
    revoked_at=None,
    is_open=True,
)
TOKEN_ROW = Token(
    token_id="t1", owner="ann", scopes=("submit",), created_at=AT, expires_at=None, last_used_at=None, revoked_at=None
)


def busy(farm: FarmState, with_what: str) -> Response | None:
    """A refusal as long as other requests of the owner are under way."""
    if not farm.busy.get(with_what):
        return None
    farm.busy[with_what] -= 1
    problem = Problem(type=f"/problems/too-many-{with_what}", title="Too many", status=429, detail="others are under way")
    return Response(problem.model_dump_json(), 429, headers={"Retry-After": "0"}, media_type=MEDIA_TYPE)


def build_app(farm: FarmState) -> FastAPI:
    app = FastAPI()

    @app.middleware("http")
    async def guard(request: Request, call_next):
        problem = farm.problem
        if request.headers.get("authorization") != f"Bearer {TOKEN}" and request.url.path != "/healthz":
            problem = Problem(type="/problems/unauthorized", title="unauthorized", status=401, detail="no valid token")
        if problem and request.url.path != "/healthz":
            return Response(problem.model_dump_json(), problem.status, media_type=MEDIA_TYPE)
        return await call_next(request)

    @app.get("/healthz")
    async def healthz():
        return {"ok": True}

    @app.put("/v1/policies/builtin/{name}")
    async def put_builtin(name: str):
        return Policy(
            digest=builtin_digest(name), name=name, weights_format="builtin", weights_sha256="0" * 64, weights_bytes=1,
            graph_sha256="0" * 64, manifest=LAYOUTS["pose"], created_at=AT,
        )  # fmt: skip

    @app.put("/v1/policies/{digest}")
    async def put_policy(digest: str, weights: UploadFile, manifest: str = Form()):
        content = await weights.read()
        sha256 = hashlib.sha256(content).hexdigest()
        checked = PolicyManifest.model_validate_json(manifest)
        assert digest == policy_digest(sha256, checked)
        if (refusal := busy(farm, "uploads")) is not None:
            return refusal
        farm.uploads.append(weights.filename or "")
        return Policy(
            digest=digest, name=checked.name, weights_format=WeightsFormat.ONNX, weights_sha256=sha256,
            weights_bytes=len(content), graph_sha256="0" * 64, manifest=checked, warnings=farm.warnings, created_at=AT,
        )  # fmt: skip

    @app.delete("/v1/policies/{digest}")
    async def delete_policy(digest: str):
        farm.commands.append(f"delete {digest}")

    @app.post("/v1/jobs")
    async def post_job(request: JobRequest, idempotency_key: str | None = Header(None)):
        farm.submissions.append((request, idempotency_key))
        if farm.post_answers_lost:
            farm.post_answers_lost -= 1
            return StreamingResponse(broken_off(b'{"job_id"', 400), headers={"content-length": "400"})
        return job(farm)

    @app.post("/v1/ladders")
    async def post_ladder(request: LadderRequest, idempotency_key: str | None = Header(None)):
        farm.ladders.append((request, idempotency_key))
        return ladder(farm)

    @app.get("/v1/ladders/{ladder_id}")
    async def get_ladder(ladder_id: str):
        return ladder(farm)

    @app.post("/v1/identifications")
    async def post_identification(request: IdentificationRequest, idempotency_key: str | None = Header(None)):
        farm.identifications.append((request, idempotency_key))
        farm.task, farm.trials = TaskName.IDENTIFY, len(request.courses())
        return job(farm, policy=None, policy_name=None, robot="robot-2")

    @app.api_route("/v1/jobs/{job_id}/trials/{ordinal}/truth", methods=["GET", "HEAD"])
    async def truth(job_id: str, ordinal: int):
        if not farm.truths_for_all:
            problem = Problem(type="/problems/scope-missing", title="Not allowed", status=403, detail="needs operate")
            return Response(problem.model_dump_json(), 403, media_type=MEDIA_TYPE)
        content = farm.truths[ordinal]
        return Response(content, headers={"etag": f'"{hashlib.sha256(content).hexdigest()}"'})

    @app.post("/v1/jobs/{job_id}/trials/{ordinal}/verify")
    async def verify(job_id: str, ordinal: int, request: Request):
        farm.verified.append((f"{job_id}-{ordinal:03d}", await request.body()))
        return busy(farm, "verifications") or farm.verdict

    @app.get("/v1/jobs")
    async def list_jobs(state: str | None = None, q: str | None = None):
        found = state in {None, farm.state.value} and q in {None, "reward"}
        return JobPage(jobs=(job(farm),) if found else (), next_cursor="more")

    @app.get("/v1/jobs/{job_id}")
    async def get_job(job_id: str):
        return job(farm)

    @app.patch("/v1/jobs/{job_id}")
    async def label(job_id: str, labels: JobLabels):
        return job(farm, **labels.model_dump(exclude_unset=True))

    @app.post("/v1/jobs/{job_id}/cancel")
    async def cancel(job_id: str):
        farm.state = JobState.CANCELLED
        return job(farm)

    @app.get("/v1/jobs/{job_id}/events")
    async def events(job_id: str, last_event_id: str | None = Header(None)):
        farm.last_event_ids.append(last_event_id)
        return busy(farm, "event-readers") or StreamingResponse(stream(farm), media_type="text/event-stream")

    @app.get("/v1/jobs/{job_id}/trials")
    async def trials(job_id: str, cursor: str | None = None):
        rows = [trial(farm, ordinal, farm.logs.get(f"{JOB_ID}-{ordinal:03d}")) for ordinal in range(farm.trials)]
        return TrialPage(trials=rows[1:]) if cursor else TrialPage(trials=rows[:1], next_cursor="1")

    @app.get("/v1/trials/{trial_id}/log")
    async def log(trial_id: str, range: str | None = Header(None)):
        farm.ranges.append(range)
        content = farm.logs[trial_id]
        start = int(range.removeprefix("bytes=").removesuffix("-")) if range else 0
        headers = {"content-length": str(len(content) - start)}
        sent = content[start : farm.log_cuts.pop()] if farm.log_cuts else content[start:]
        return StreamingResponse(broken_off(sent, len(content) - start), 206 if range else 200, headers)

    @app.get("/v1/jobs/{job_id}/report")
    async def report(job_id: str):
        return Response(farm.reports.get(job_id, farm.report), media_type="application/json")

    @app.get("/v1/jobs/{job_id}/report/text")
    async def report_text(job_id: str):
        return PlainTextResponse("push: 2 of 3 trials succeeded\n")

    @app.get("/v1/robots")
    async def robots():
        return RobotPage(robots=(ROBOT,))

    @app.delete("/v1/robots/{robot}")
    async def forget_robot(robot: str):
        farm.commands.append(f"forget {robot}")

    @app.post("/v1/robots/{robot}/{command}")
    async def command(robot: str, command: str):
        if robot == "robot0":
            problem = Problem(type="/problems/robot-not-found", title="Not found", status=404, detail="No robot named robot0.")
            return Response(problem.model_dump_json(), 404, media_type=MEDIA_TYPE)
        farm.commands.append(f"{command} {robot}")
        return ROBOT.model_copy(update={"state": RobotState.DRAINING})

    @app.get("/v1/canary")
    async def get_canary():
        return canary(farm.canaries[-1])

    @app.put("/v1/canary")
    async def put_canary(request: CanaryRequest):
        farm.canaries.append(request)
        return canary(request)

    @app.delete("/v1/canary")
    async def delete_canary():
        farm.canaries.clear()

    @app.get("/v1/status")
    async def status():
        return STATUS

    @app.get("/v1/tokens")
    async def tokens():
        return TokenPage(tokens=(TOKEN_ROW,))

    @app.post("/v1/tokens")
    async def create_token(request: TokenRequest):
        return NewToken(**TOKEN_ROW.model_dump() | {"owner": request.owner, "scopes": request.scopes}, secret="trifarm_t1_hush")

    @app.delete("/v1/tokens/{token_id}")
    async def revoke(token_id: str):
        farm.commands.append(f"revoke {token_id}")
        return JSONResponse({})

    @app.get("/v1/shares")
    async def shares():
        return SharePage(shares=(SHARE,))

    @app.post("/v1/shares")
    async def share(request: ShareRequest):
        named = {"trial_id": request.trial, "at_s": request.at_s}
        return NewShare(**SHARE.model_dump() | named, url="http://farm/shared/hush")

    @app.delete("/v1/shares/{share_id}")
    async def revoke_share(share_id: str):
        farm.commands.append(f"revoke {share_id}")
        return JSONResponse({})

    return app


class Cut(Exception):
    """The server breaks the connection off."""


async def broken_off(sent: bytes, promised: int) -> AsyncIterator[bytes]:
    """Send less than was promised, if ``sent`` is shorter, and break off."""
    yield sent
    if len(sent) < promised:
        raise Cut


async def stream(farm: FarmState) -> AsyncIterator[str]:
    for row in farm.streams.pop(0) if farm.streams else []:
        if row is None:
            yield ": alive\n\n"
            continue
        farm.state = row.state
        yield f"event: {row.kind}\nid: {row.id}\ndata: {row.model_dump_json()}\n\n"
    while farm.hang_stream:  # noqa: ASYNC110, the test runs in another thread
        await asyncio.sleep(0.05)


@contextmanager
def serving(farm: FarmState) -> Iterator[str]:
    """Serve on a free port of the loopback in a thread; gives the URL."""
    config = uvicorn.Config(build_app(farm), port=0, log_config=None, ws="none", lifespan="off", timeout_graceful_shutdown=1)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    finally:
        farm.hang_stream = False
        server.should_exit = True
        thread.join(10)
        assert not thread.is_alive(), "the server has not ended"
