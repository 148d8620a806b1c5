"""The clients: each submits jobs at its own pace, tries again until it has an answer, and reads its reports."""

import asyncio
import hashlib
import random
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from chaos.history import History
from chaos.relay import Relay
from chaos.robot import problem_of

FINAL = frozenset({"succeeded", "failed", "cancelled"})
TRY_AGAIN_S = (0.1, 0.2, 0.5, 1.0, 2.0)
ANSWER_WITHIN_S = 15.0
TYPED = frozenset({408, 409, 413, 429, 503})


@dataclass(frozen=True)
class Load:
    """What the clients are to do.

    Args:
        clients: how many.
        jobs: how many jobs all of them submit together, each of one trial but every tenth, which is of four.
        pace_s: the mean time between two submissions of one client.
        without_key: the share of submissions that are sent without an Idempotency-Key.
        seed: of the pauses and of the jobs' seeds.
        only_single: every job has one trial.
    """

    clients: int
    jobs: int
    pace_s: float
    seed: int
    without_key: float = 0.1
    only_single: bool = False


@dataclass
class Clients:
    """The clients of a run, on a thread of their own; they ask through the relay."""

    load: Load
    tokens: list[str]
    policy: str
    evidence: Path
    address: str = ""
    relay: Relay | None = None
    acknowledged: int = 0
    unfinished: int = 0
    _stop: threading.Event = field(default_factory=threading.Event)
    _left: int = 0
    _submitting: int = 0
    _loop: asyncio.AbstractEventLoop | None = None
    _errors: list[BaseException] = field(default_factory=list)

    def cut(self, answers: int) -> None:
        """Has so many of the next answers to submissions cut off."""
        assert self._loop is not None
        assert self.relay is not None
        self._loop.call_soon_threadsafe(self.relay.cut, answers)

    def taken(self) -> int:
        """How many jobs were acknowledged."""
        self.check()
        return self.acknowledged

    def submit_no_more(self) -> None:
        """What was begun is submitted, and nothing after it."""
        self._left = 0

    def all_submitted(self) -> bool:
        """Whether every job was acknowledged."""
        self.check()
        return self._left == 0 and self._submitting == 0

    def all_over(self) -> bool:
        """Whether every job that was acknowledged is over, and its report read."""
        return self.all_submitted() and self.unfinished == 0

    def check(self) -> None:
        """Raises what ended a client, if anything did."""
        if self._errors:
            raise self._errors[0]

    def run(self, host: str, port: int, opened: threading.Event) -> None:
        """The thread."""
        try:
            asyncio.run(self._run(host, port, opened))
        except BaseException as error:
            self._errors.append(error)
            opened.set()

    async def _run(self, host: str, port: int, opened: threading.Event) -> None:
        self._loop, self.relay, self._left = asyncio.get_running_loop(), Relay(host, port), self.load.jobs
        self.address = await self.relay.open()
        opened.set()
        working = [asyncio.create_task(self._client(number)) for number in range(self.load.clients)]
        while not self._stop.is_set() and not any(each.done() for each in working):  # noqa: ASYNC110  another thread sets it
            await asyncio.sleep(0.1)
        for each in working:
            each.cancel()
        ended = await asyncio.gather(*working, return_exceptions=True)
        self._errors += [each for each in ended if isinstance(each, Exception)]
        self.relay.close()

    async def _client(self, number: int) -> None:
        history = History(self.evidence, f"client-{number}")
        rng = random.Random(f"{self.load.seed}-{number}")
        token = self.tokens[number % len(self.tokens)]
        client = _Client(number, f"user-{number % len(self.tokens)}", history, rng, self)
        limits = httpx.Limits(max_connections=2, max_keepalive_connections=2)
        headers = {"Authorization": f"Bearer {token}"}
        async with httpx.AsyncClient(
            base_url=self.address, headers=headers, timeout=ANSWER_WITHIN_S, trust_env=False, limits=limits
        ) as http:
            await asyncio.sleep(rng.uniform(0, self.load.pace_s))
            while self._left > 0:
                self._left, self._submitting = self._left - 1, self._submitting + 1
                await client.submit(http)
                self._submitting -= 1
                await asyncio.sleep(rng.uniform(0, 2 * self.load.pace_s))
                await client.look(http)
            while True:
                await asyncio.sleep(rng.uniform(0.5, 1.5))
                await client.look(http)


@dataclass
class _Client:
    """One client. Owner of the list of its jobs that are not over."""

    number: int
    owner: str
    history: History
    rng: random.Random
    clients: Clients
    sent: int = 0
    unfinished: list[str] = field(default_factory=list)

    async def submit(self, http: httpx.AsyncClient) -> None:
        """One job, sent until it is acknowledged."""
        self.sent += 1
        load = self.clients.load
        key = None if self.rng.random() < load.without_key else f"{load.seed}-{self.number}-{self.sent}"
        trials = 1 if load.only_single or self.sent % 10 else 4
        body = {"policy": self.clients.policy, "task": "push", "trials": trials, "seed": self.rng.randrange(2**31)}
        headers = {} if key is None else {"Idempotency-Key": key}
        about = {"owner": self.owner, "key": key, "trials": trials}
        for attempt in range(10_000):
            self.history("submits", **about)
            try:
                answer = await http.post("/v1/jobs", json=body, headers=headers)
            except httpx.TransportError as error:
                self.history("unanswered", error=type(error).__name__, asked="submitted a job", **about)
                await self._pause(attempt)
                continue
            if answer.is_success:
                job_id = answer.json()["job_id"]
                self.history("acknowledged", job=job_id, status=answer.status_code, **about)
                self.unfinished.append(job_id)
                self.clients.acknowledged += 1
                self.clients.unfinished += 1
                return
            problem = problem_of(answer)
            self.history("refused", status=answer.status_code, problem=problem, asked="submitted a job", **about)
            if answer.status_code < 500 and answer.status_code not in TYPED:
                raise RuntimeError(f"a submission was refused for good: {answer.text[:500]}")
            await self._pause(attempt)

    async def look(self, http: httpx.AsyncClient) -> None:
        """Looks whether the oldest of its jobs are over, and reads the reports of those that are."""
        for job_id in self.unfinished[:3]:
            job = await self._get(http, f"/v1/jobs/{job_id}")
            if job is None or job.json()["state"] not in FINAL:
                return
            if job.json()["state"] == "succeeded":
                report = await self._get(http, f"/v1/jobs/{job_id}/report")
                if report is None:
                    return
                self.history("read-report", job=job_id, sha256=hashlib.sha256(report.content).hexdigest())
            self.unfinished.remove(job_id)
            self.clients.unfinished -= 1

    async def _get(self, http: httpx.AsyncClient, path: str) -> httpx.Response | None:
        try:
            answer = await http.get(path)
        except httpx.TransportError:
            return None
        if answer.is_success:
            return answer
        self.history("refused", status=answer.status_code, problem=problem_of(answer), asked=f"asked for {path}")
        return None

    async def _pause(self, attempt: int) -> None:
        await asyncio.sleep(TRY_AGAIN_S[min(attempt, len(TRY_AGAIN_S) - 1)] * self.rng.uniform(0.5, 1.5))


@contextmanager
def clients(load: Load, tokens: list[str], policy: str, evidence: Path, host: str, port: int) -> Iterator[Clients]:
    """Clients at work until the block ends."""
    at_work, opened = Clients(load, tokens, policy, evidence), threading.Event()
    thread = threading.Thread(target=at_work.run, args=(host, port, opened), name="clients", daemon=True)
    thread.start()
    try:
        opened.wait(10)
        yield at_work
    finally:
        at_work._stop.set()
        thread.join(20)
