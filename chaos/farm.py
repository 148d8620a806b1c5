"""The farm that is broken: its processes, where they listen, and how one sees that it is ready again."""

import hashlib
import secrets
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import safetensors.numpy

from api_schemas.policy import LAYOUTS, canonical_json, policy_digest
from chaos import services as entry
from chaos.history import History
from chaos.homes import EMBEDDED, ScaleHome, scale_home
from chaos.orders import Orders
from chaos.processes import DidNotHappen, Process, free_port, module, until
from chaos.wire import Wire

READY_WITHIN_S = 180.0
IN_SERVICE = frozenset({"idle", "leased", "running"})
HOST = "127.0.0.1"
OWNERS = 5
WORDS = "logs"
"""Folder of what the processes write, on the farm's disk, as everything else of it."""
MOVE_NOTHING = "rrc2022-push"


@dataclass(frozen=True)
class FarmSettings:
    """What the farm is to be.

    Args:
        home: ``embedded`` or ``scale``.
        robots: how many.
        lease_s: how long a lease lives without renewal.
        trial_s: how long a robot acts in a trial.
        without: the protection that is lifted, if any.
        dispatchers: how many, where they are processes of their own.
    """

    home: str = EMBEDDED
    robots: int = 4
    lease_s: float = 3.0
    trial_s: float = 0.06
    without: str | None = None
    dispatchers: int = 2


@dataclass
class Farm:
    """A farm on loopback. Owner of its processes; ``disk`` holds all that it keeps and says, ``evidence`` the histories."""

    settings: FarmSettings
    disk: Path
    evidence: Path
    processes: dict[str, Process]
    wire: Wire | None = None
    home: ScaleHome | None = None
    admin: str = field(default_factory=lambda: f"trifarm_chaos.admin_{secrets.token_hex(16)}")
    robot_token: str = field(default_factory=lambda: f"trifarm_chaos.robot_{secrets.token_hex(16)}")
    port: int = field(default_factory=free_port)
    bus_port: int = field(default_factory=free_port)
    policy: str = ""
    tokens: list[str] = field(default_factory=list)
    """Of the users whose jobs the clients submit."""

    def __post_init__(self) -> None:
        self.history = History(self.evidence, "faults")
        self.orders = Orders(self.evidence)
        self.words = self.disk / WORDS
        self.words.mkdir(parents=True, exist_ok=True)
        self.url = f"http://{HOST}:{self.port}"
        self.http = httpx.Client(
            base_url=self.url, headers={"Authorization": f"Bearer {self.admin}"}, timeout=20, trust_env=False
        )

    @property
    def services(self) -> list[str]:
        """The names of the processes that answer requests or give leases."""
        if self.settings.home == EMBEDDED:
            return ["services"]
        return ["api", *(f"dispatcher-{number}" for number in range(self.settings.dispatchers))]

    @property
    def api(self) -> Process:
        """The process that answers requests."""
        return self.processes[self.services[0]]

    @property
    def robots(self) -> list[str]:
        """The names of the robots."""
        return [f"robot-{number}" for number in range(self.settings.robots)]

    def start(self) -> None:
        """Starts all processes and uploads a policy; the farm is ready when this returns."""
        if self.settings.home != EMBEDDED:
            self.home = scale_home(self.disk, self.words, self.processes)
            self.home.start()
        listen = "0.0.0.0" if self.wire is not None else HOST  # noqa: S104  in a network namespace of the run's own
        self._add("router", [*module("services"), "router", "--bus", f"tcp/{listen}:{self.bus_port}"], {})
        serve = ["--host", listen, "--port", str(self.port)]
        for name in self.services:
            alone = ["--no-dispatch"] if name == "api" else []
            flags = ["dispatch"] if name.startswith("dispatcher") else ["serve", *serve, *alone]
            own = ["--data", str(self.disk / name), "--bus-connect", f"tcp/{HOST}:{self.bus_port}"]
            self._add(name, [*module("chaos"), "services", *flags, *own], self._told(name))
        for name in self.robots:
            self._add(name, self._robot(name), {"TRIFARM_ROBOT_TOKEN": self.robot_token})
        self.processes["router"].start()
        for name in self.services:
            self.processes[name].start()
        self.ready_api()
        self.tokens = [self.make_token(f"user-{number}", "submit") for number in range(OWNERS)]
        self.policy = self._upload(self.admin)
        for token in self.tokens:
            self._upload(token)
        for name in self.robots:
            self.processes[name].start()
        self.ready_robots()

    def ready_api(self, within_s: float = READY_WITHIN_S) -> float:
        """Waits until the API answers; gives after how many seconds it did."""
        return until(self._answers, within_s, f"an answer of the API ({self.api.said()})")

    def ready_robots(self, within_s: float = READY_WITHIN_S) -> float:
        """Waits until the API sees all robots in service; gives after how many seconds."""
        return until(lambda: self.in_service() >= self.settings.robots, within_s, "all robots in service", every_s=0.1)

    def seen(self) -> dict[str, dict[str, Any]]:
        """The robots as the API shows them; none when it does not answer.

        A robot that the farm took out of service, since attempts on it failed again and again, is brought back, as an operator
        would who knows that the faults were not its own.
        """
        seen = {each["robot"]: each for each in (self.ask("GET", "/v1/robots") or {"robots": []})["robots"]}
        for name, each in seen.items():
            if each["state"] == "out_of_service":
                self.history("resumed", robot=name, because=each["reason"])
                self.ask("POST", f"/v1/robots/{name}/resume")
        return seen

    def in_service(self) -> int:
        """How many robots the API sees in service."""
        return sum(each["state"] in IN_SERVICE for each in self.seen().values())

    def _is_back(self, robot: str, pid: int) -> bool:
        each = self.seen().get(robot)
        return each is not None and each["pid"] == pid and each["state"] in IN_SERVICE

    def _all_heard(self, since: dict[str, dict[str, Any]]) -> bool:
        now = self.seen()
        heard = [name for name, each in now.items() if each["last_seen_at"] != since.get(name, {}).get("last_seen_at")]
        return len(heard) >= self.settings.robots and self.in_service() >= self.settings.robots

    def restart(self, name: str, **more: str) -> float:
        """Starts a process that was killed, at once as a supervisor would; gives after how many seconds it is ready."""
        process, before = self.processes[name], self.seen() if name == "router" else {}
        began_s, said = time.monotonic(), process.log.stat().st_size
        process.start(**more)
        if name == self.services[0]:
            self.ready_api()
        elif name in self.services:
            until(lambda: b'"dispatching"' in process.log.read_bytes()[said:], READY_WITHIN_S, f"{name} to dispatch")
        elif name == "router":
            until(lambda: self._all_heard(before), READY_WITHIN_S, "a sign of life of every robot on the bus")
        elif name in self.robots:
            pid = process.running.pid if process.running is not None else 0
            until(lambda: self._is_back(name, pid), READY_WITHIN_S, f"{name} in service")
        return time.monotonic() - began_s

    def start_the_ended(self) -> list[str]:
        """Starts what has ended without our doing, as a supervisor would; gives the names."""
        ended = [name for name, process in self.processes.items() if not process.is_alive()]
        for name in ended:
            if self.home is not None and name == self.home.database.name:
                self.home.start_database()
            else:
                self.processes[name].start()
        return ended

    def ask(self, method: str, path: str, **more: Any) -> Any:
        """The document that the API answers with; None when it does not answer, or with an error."""
        try:
            answer = self.http.request(method, path, **more)
        except httpx.TransportError:
            return None
        return answer.json() if answer.is_success and answer.content else None

    def make_token(self, owner: str, *scopes: str, days: float | None = None) -> str:
        """A new token."""
        body = {"owner": owner, "scopes": scopes} | ({} if days is None else {"expires_in_days": days})
        made = self.ask("POST", "/v1/tokens", json=body)
        if made is None:
            raise DidNotHappen(f"the API made no token for {owner}")
        return made["secret"]

    def close(self) -> None:
        """Closes what this process holds open of it, and keeps what its processes said."""
        shutil.copytree(self.words, self.evidence / WORDS, dirs_exist_ok=True)
        self.http.close()
        self.history.close()

    def _add(self, name: str, command: list[str], environment: dict[str, str]) -> None:
        where = self.wire.on_the_other_side if self.wire is not None and name in self.robots else ()
        self.processes[name] = Process(name, [*where, *command], environment, self.words / f"{name}.log")

    def _told(self, name: str) -> dict[str, str]:
        told = {
            "TRIFARM_ADMIN_TOKEN": self.admin,
            "TRIFARM_ROBOT_TOKEN": self.robot_token,
            "TRIFARM_LEASE_S": str(self.settings.lease_s),
            "TRIFARM_RENEW_EVERY_S": str(self.settings.lease_s / 3),
            "TRIFARM_MAX_ATTEMPTS": "50",  # that a trial which is hit too often fails its job is tested elsewhere
            "TRIFARM_REQUESTS_PER_S": "0",
            "TRIFARM_ROBOT_REQUESTS_PER_S": "0",
            "TRIFARM_MAX_QUEUED_JOBS_PER_USER": "100000",
            entry.EVIDENCE: str(self.evidence),
            entry.NAME: name,
        }
        without = {} if self.settings.without is None else {entry.WITHOUT: self.settings.without}
        return told | without | ({} if self.home is None else self.home.settings)

    def _robot(self, name: str) -> list[str]:
        api, bus = (HOST, HOST) if self.wire is None else (self.wire.api_host, self.wire.bus_host)
        where = ["--api", f"http://{api}:{self.port}", "--bus", f"tcp/{bus}:{self.bus_port}"]
        own = ["--evidence", str(self.evidence), "--trial-s", str(self.settings.trial_s), "--folder", str(self.disk / name)]
        return [*module("chaos"), "robot", name, *where, *own]

    def _answers(self) -> bool:
        if not self.api.is_alive():
            raise DidNotHappen(f"{self.api.name} ended by itself: {self.api.said()}")
        return self.ask("GET", "/healthz") is not None

    def _upload(self, token: str) -> str:
        weights, manifest = small_policy()
        digest = policy_digest(hashlib.sha256(weights).hexdigest(), manifest)
        files, data = {"weights": ("weights.safetensors", weights)}, {"manifest": canonical_json(manifest)}
        own = {"Authorization": f"Bearer {token}"}
        answer = self.http.put(f"/v1/policies/{digest}", files=files, data=data, headers=own, timeout=120)
        if not answer.is_success:
            raise DidNotHappen(f"the farm did not take the policy: {answer.text}")
        return digest


def small_policy(seed: int = 0) -> tuple[bytes, Any]:
    """Random weights that fit a layout, with their manifest; robots without physics never ask them."""
    manifest, rng = LAYOUTS[MOVE_NOTHING], np.random.default_rng(seed)
    sizes = {"layer0": (8, manifest.observation_size), "layer1": (9, 8)}
    tensors = {f"{name}.weight": rng.normal(0, 0.1, size).astype(np.float32) for name, size in sizes.items()}
    tensors |= {f"{name}.bias": rng.normal(0, 0.1, size[0]).astype(np.float32) for name, size in sizes.items()}
    tensors["torque_limit_nm"] = np.full(9, 0.397, np.float32)
    return safetensors.numpy.save(tensors), manifest
