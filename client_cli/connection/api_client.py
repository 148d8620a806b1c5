"""The only file that speaks HTTP: one method for each request, pydantic schemas in and out, errors that say what to do."""

import json
import ssl
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar

import httpx
from pydantic import BaseModel, ValidationError

from api_schemas.canary import Canary, CanaryRequest
from api_schemas.error import Problem
from api_schemas.excitation import IdentificationRequest
from api_schemas.job import Job, JobEvent, JobLabels, JobPage, JobRequest, JobState
from api_schemas.ladder import Ladder, LadderRequest
from api_schemas.leaderboard import Leaderboard
from api_schemas.physics import ObjectName
from api_schemas.policy import Policy, PolicyManifest, canonical_json
from api_schemas.report import IdentificationReport, Report, read_report
from api_schemas.robot import Robot, RobotPage
from api_schemas.share import NewShare, Share, SharePage, ShareRequest
from api_schemas.signature import Signature
from api_schemas.status import FarmStatus
from api_schemas.token import NewToken, Token, TokenPage, TokenRequest
from api_schemas.trial import Trial, TrialPage, Verification
from api_schemas.why import TrialWhy
from client_cli.connection.paths import job_path, ladder_path, robot_path, share_path, token_path, trial_path
from client_cli.connection.patience import patiently
from client_cli.connection.settings import Connection
from client_cli.terminal.errors import ClientError, Refused, ServerAway, UsageProblem

TIMEOUT = httpx.Timeout(30.0, connect=5.0)
UPLOAD_TIMEOUT = httpx.Timeout(180.0, connect=5.0)
"""A policy's upload answers only after its conversion and dry run."""
STREAM_TIMEOUT = httpx.Timeout(45.0, connect=5.0)
"""Three missed heartbeats of an event stream (15 s each) mean that the link is dead."""
POST_TRIES = 4
CHUNK_BYTES = 1 << 18
VERIFICATION_TIMEOUT = httpx.Timeout(600.0, connect=5.0)
"""A verification answers only when the log has been simulated again, and may wait for others before."""

Answer = TypeVar("Answer", bound=BaseModel)
ListPage = TypeVar("ListPage", TrialPage, RobotPage, TokenPage, SharePage)


@dataclass(frozen=True)
class StoredFile:
    """A file on the server: its path, its SHA-256, and its size if that is known."""

    path: str
    sha256: str
    size_bytes: int | None


class ApiClient:
    """A connection to one server; use it as a context manager. Its requests may be made from several threads."""

    def __init__(self, connection: Connection):
        self.url = connection.url
        headers = {"Authorization": f"Bearer {connection.token}"} if connection.token else {}
        # A proxy for the outside world must not stand between us and a farm on this very machine.
        is_local = _host(connection.url) in {"127.0.0.1", "localhost", "::1"}
        self._ca = connection.ca
        trusted = True if connection.ca is None else _trusted(connection.ca)
        self._http = httpx.Client(
            base_url=connection.url, headers=headers, timeout=TIMEOUT, trust_env=not is_local, verify=trusted
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._http.close()

    def is_up(self) -> bool:
        """Whether a server answers /healthz with 200."""
        try:
            return self._http.get("/healthz").status_code == httpx.codes.OK
        except httpx.RequestError:
            return False

    def upload_policy(self, digest: str, weights: Path, manifest: PolicyManifest) -> Policy:
        """Bring a policy to the server; one that is there already is not stored twice. Waits for other uploads of the owner."""

        def put() -> httpx.Response:
            with weights.open("rb") as file:
                return self._send(
                    "PUT",
                    f"/v1/policies/{digest}",
                    files={"weights": (weights.name, file, "application/octet-stream")},
                    data={"manifest": canonical_json(manifest)},
                    timeout=UPLOAD_TIMEOUT,
                )

        return self._answer(Policy, patiently(put))

    def take_builtin(self, name: str) -> Policy:
        """Make a policy that comes with the farm one's own; for operators."""
        return self._answer(Policy, self._send("PUT", f"/v1/policies/builtin/{name}"))

    def delete_policy(self, digest: str) -> None:
        """Delete a policy of one's own."""
        self._send("DELETE", f"/v1/policies/{digest}")

    def create_job(self, request: JobRequest, idempotency_key: str) -> Job:
        """Queue a job. The key makes it safe to ask again when an answer got lost on the way."""
        return self._create(Job, "/v1/jobs", request, idempotency_key)

    def create_identification(self, request: IdentificationRequest, idempotency_key: str) -> Job:
        """Queue an identification, as ``create_job`` does a job."""
        return self._create(Job, "/v1/identifications", request, idempotency_key)

    def create_ladder(self, request: LadderRequest, idempotency_key: str) -> Ladder:
        """Queue a job for each checkpoint, as ``create_job`` does one."""
        return self._create(Ladder, "/v1/ladders", request, idempotency_key)

    def ladder(self, ladder_id: str) -> Ladder:
        """One ladder."""
        return self._get(Ladder, ladder_path(ladder_id))

    def leaderboard(self, task: str, thing: ObjectName, scale: float, physics: int | None) -> Leaderboard:
        """The board of a task."""
        wanted = {"object": thing.value, "object_scale": scale, "physics": physics}
        return self._get(Leaderboard, f"/v1/leaderboard/{task}", params={k: v for k, v in wanted.items() if v is not None})

    def _create(self, schema: type[Answer], path: str, request: BaseModel, idempotency_key: str) -> Answer:
        for left in reversed(range(POST_TRIES)):
            try:
                headers = {"Idempotency-Key": idempotency_key}
                body = request.model_dump(mode="json")
                return self._answer(schema, self._send("POST", path, json=body, headers=headers))
            except ServerAway:
                if not left:
                    raise
                time.sleep(0.5)
        raise AssertionError("the last try returns or raises")

    def jobs(self, *, limit: int, state: JobState | None = None, cursor: str | None = None, text: str | None = None) -> JobPage:
        """One page of jobs, newest first, with a text in a name, a note or an id."""
        query = {"limit": limit, "state": state and state.value, "cursor": cursor, "q": text}
        return self._get(JobPage, "/v1/jobs", params={key: value for key, value in query.items() if value is not None})

    def job(self, job_id: str) -> Job:
        """One job."""
        return self._get(Job, job_path(job_id))

    def label(self, job_id: str, labels: JobLabels) -> Job:
        """Set a job's name and note, those that are given."""
        return self._answer(Job, self._send("PATCH", job_path(job_id), json=labels.model_dump(mode="json", exclude_unset=True)))

    def cancel(self, job_id: str) -> Job:
        """Cancel a job; running trials are stopped."""
        return self._answer(Job, self._send("POST", f"{job_path(job_id)}/cancel"))

    def events(self, job_id: str, after: int | None) -> Iterator[JobEvent | None]:
        """A job's events from the one after ``after``; None whenever the server only says that it is alive."""
        headers = {"Accept": "text/event-stream"} | ({} if after is None else {"Last-Event-ID": str(after)})
        with self._stream(f"{job_path(job_id)}/events", headers, STREAM_TIMEOUT) as response:
            yield from job_events(self._guarded(response.iter_lines()))

    def trials(self, job_id: str) -> tuple[Trial, ...]:
        """All trials of a job in their order."""
        pages = self._pages(TrialPage, f"{job_path(job_id)}/trials")
        return tuple(trial for page in pages for trial in page.trials)

    def truth(self, trial_id: str) -> StoredFile:
        """Where a trial's truth is, and what it is; for operators."""
        path = f"{trial_path(trial_id)}/truth"
        headers = self._send("HEAD", path, headers={"Accept-Encoding": "identity"}).headers
        return StoredFile(path, headers.get("etag", "").strip('"'), int(headers.get("content-length", 0)))

    def verify(self, trial_id: str, log: Path) -> Verification:
        """Have the server simulate a log again on the robot of its trial. Waits for another one of the owner."""

        def post() -> httpx.Response:
            with log.open("rb") as file:
                chunks = iter(lambda: file.read(CHUNK_BYTES), b"")
                headers = {"Content-Length": str(log.stat().st_size)}
                path = f"{trial_path(trial_id)}/verify"
                return self._send("POST", path, content=chunks, headers=headers, timeout=VERIFICATION_TIMEOUT)

        return self._answer(Verification, patiently(post))

    def ask_why(self, trial_id: str) -> TrialWhy:
        """Ask why a trial failed; the answer comes later, and :meth:`why` shows it."""
        return self._answer(TrialWhy, self._send("POST", f"{trial_path(trial_id)}/why"))

    def why(self, trial_id: str) -> TrialWhy:
        """What is known of why a trial failed."""
        return self._get(TrialWhy, f"{trial_path(trial_id)}/why")

    @contextmanager
    def file(self, path: str, offset: int) -> Iterator[tuple[int, Iterator[bytes]]]:
        """A stored file from byte ``offset``, as the offset at which the server really starts and the bytes."""
        headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={offset}-"} if offset else {})
        with self._stream(path, headers, TIMEOUT) as response:
            start = offset if response.status_code == httpx.codes.PARTIAL_CONTENT else 0
            yield start, self._guarded(response.iter_bytes(CHUNK_BYTES))

    def report(self, job_id: str) -> bytes:
        """The report as stored, byte by byte: it never changes."""
        response = self._send("GET", f"{job_path(job_id)}/report")
        try:
            is_report = isinstance(json.loads(response.content), dict)
        except (ValueError, RecursionError):
            is_report = False
        if not is_report:
            raise self._foreign(response, "report")
        return response.content

    def known_report(self, job_id: str) -> Report | IdentificationReport:
        """The report as this version understands it."""
        response = self._send("GET", f"{job_path(job_id)}/report")
        try:
            return read_report(response.content)
        except ValidationError as error:
            raise self._foreign(response, "report", error) from error

    def report_text(self, job_id: str) -> str:
        """The report for people."""
        response = self._send("GET", f"{job_path(job_id)}/report/text")
        if not response.headers.get("content-type", "").startswith("text/plain"):  # such as a page of a proxy's
            raise self._foreign(response, "report")
        return response.text

    def signature(self, job_id: str) -> Signature:
        """The farm's word for the report."""
        return self._get(Signature, f"{job_path(job_id)}/report/signature")

    def robots(self) -> tuple[Robot, ...]:
        """All robots, by name."""
        return tuple(robot for page in self._pages(RobotPage, "/v1/robots") for robot in page.robots)

    def drain(self, robot: str) -> Robot:
        """Let a robot finish its trial and take no other."""
        return self._answer(Robot, self._send("POST", f"{robot_path(robot)}/drain"))

    def resume(self, robot: str) -> Robot:
        """Let a drained robot take trials again."""
        return self._answer(Robot, self._send("POST", f"{robot_path(robot)}/resume"))

    def forget(self, robot: str) -> None:
        """Keep nothing more of a robot that is gone for good."""
        self._send("DELETE", robot_path(robot))

    def canary(self) -> Canary:
        """What idle robots try from time to time."""
        return self._get(Canary, "/v1/canary")

    def set_canary(self, request: CanaryRequest) -> Canary:
        """Have idle robots try a policy from time to time."""
        return self._answer(Canary, self._send("PUT", "/v1/canary", json=request.model_dump(mode="json")))

    def drop_canary(self) -> None:
        """Have no canary any more."""
        self._send("DELETE", "/v1/canary")

    def status(self) -> FarmStatus:
        """How the farm is."""
        return self._get(FarmStatus, "/v1/status")

    def create_token(self, request: TokenRequest) -> NewToken:
        """Make a token; its secret is in this answer and nowhere else."""
        return self._answer(NewToken, self._send("POST", "/v1/tokens", json=request.model_dump(mode="json")))

    def tokens(self) -> tuple[Token, ...]:
        """All tokens, oldest first."""
        tokens = [token for page in self._pages(TokenPage, "/v1/tokens") for token in page.tokens]
        return tuple(sorted(tokens, key=lambda token: (token.created_at, token.token_id)))

    def revoke_token(self, token_id: str) -> None:
        """End a token's life."""
        self._send("DELETE", token_path(token_id))

    def share(self, request: ShareRequest) -> NewShare:
        """Share a report or a trial; the link is in this answer and nowhere else."""
        return self._answer(NewShare, self._send("POST", "/v1/shares", json=request.model_dump(mode="json")))

    def shares(self) -> tuple[Share, ...]:
        """All shares of one's own and of one's jobs, newest first."""
        return tuple(share for page in self._pages(SharePage, "/v1/shares") for share in page.shares)

    def revoke_share(self, share_id: str) -> None:
        """End a share."""
        self._send("DELETE", share_path(share_id))

    def _pages(self, schema: type[ListPage], path: str) -> Iterator[ListPage]:
        cursor: str | None = None
        while True:
            page = self._page(schema, path, cursor)
            yield page
            if (cursor := page.next_cursor) is None:
                return

    def _page(self, schema: type[ListPage], path: str, cursor: str | None) -> ListPage:
        return patiently(lambda: self._get(schema, path, params={"cursor": cursor} if cursor else None))

    def _get(self, schema: type[Answer], path: str, **request: Any) -> Answer:
        return self._answer(schema, self._send("GET", path, **request))

    def _send(self, method: str, path: str, **request: Any) -> httpx.Response:
        try:
            response = self._http.request(method, path, **request)
        except httpx.RequestError as error:
            raise self._away(error) from error
        if not response.is_success:
            raise _refused(response)
        return response

    @contextmanager
    def _stream(self, path: str, headers: dict[str, str], timeout: httpx.Timeout) -> Iterator[httpx.Response]:
        try:
            with self._http.stream("GET", path, headers=headers, timeout=timeout) as response:
                if not response.is_success:
                    response.read()
                    raise _refused(response)
                yield response
        except httpx.RequestError as error:
            raise self._away(error) from error

    def _guarded(self, parts: Iterator[Any]) -> Iterator[Any]:
        try:
            yield from parts
        except httpx.RequestError as error:
            raise self._away(error) from error

    def _away(self, error: httpx.RequestError) -> ServerAway:
        said = str(error) or type(error).__name__
        if "certificate" in said.lower():
            trusts = "is not set" if self._ca is None else f"is {self._ca}"
            said += f"; TRIFARM_CA names the PEM file with the certificates to trust, and {trusts}"
        return ServerAway(self.url, said)

    def _answer(self, schema: type[Answer], response: httpx.Response) -> Answer:
        try:
            return schema.model_validate_json(response.content)
        except ValidationError as error:
            raise self._foreign(response, schema.__name__, error) from error

    def _foreign(self, response: httpx.Response, wanted: str, error: ValidationError | None = None) -> ClientError:
        """The error for a success that is none of a farm's: a proxy may show a page of its own in its place."""
        asked = f"{response.request.method} {response.request.url.path}"
        how = "" if error is None else f" ({error.error_count()} differences)"
        what = f"something that is not a {wanted}{how}"
        return ClientError(f"{self.url} answered {asked} with {what}: is it a trifarm server of the same version?")


def _host(url: str) -> str:
    try:
        host = httpx.URL(url).host
        host.encode("idna")  # as it is when its address is looked up
    except (httpx.InvalidURL, UnicodeError) as error:
        raise UsageProblem(f"the server's address is {url!r:.100}, whose host cannot be looked up ({error})") from error
    return host


def _trusted(ca: str) -> ssl.SSLContext:
    try:
        return ssl.create_default_context(cafile=ca)
    except (ssl.SSLError, OSError) as error:
        raise UsageProblem(f"TRIFARM_CA names {ca}, which holds no certificate in PEM that can be read ({error})") from error


def log_of(trial: Trial) -> StoredFile:
    """Where the log of a trial is that has one, and what it is."""
    return StoredFile(f"/v1/trials/{trial.trial_id}/log", trial.log_sha256 or "", trial.log_bytes)


def _refused(response: httpx.Response) -> Refused:
    after = response.headers.get("retry-after", "")
    return Refused(problem_of(response), float(after) if after.isascii() and after.isdigit() else None)


def problem_of(response: httpx.Response) -> Problem:
    """The problem document of a refused request, or one made of what else came back (a proxy's page, say)."""
    try:
        problem = Problem.model_validate_json(response.content)
    except ValidationError:
        text = response.text.strip().splitlines()[:1]
        title = f"HTTP {response.status_code} {response.reason_phrase}".rstrip()
        problem = Problem(type="about:blank", title=title, status=response.status_code, detail=text[0][:200] if text else title)
    if problem.status == httpx.codes.UNAUTHORIZED:
        where = "TRIFARM_TOKEN names the token, or the settings file that of its own farm"
        return problem.model_copy(update={"detail": f"{problem.detail} ({where})"})
    return problem


def job_events(lines: Iterable[str]) -> Iterator[JobEvent | None]:
    """The events in ``lines`` (without line ends); None for a comment, which is how the server says that it is alive."""
    data: list[str] = []
    for line in lines:
        if line.startswith(":"):
            yield None
        elif line.startswith("data:"):
            data.append(line[5:].removeprefix(" "))
        elif not line and data:
            yield JobEvent.model_validate_json("\n".join(data))
            data = []
