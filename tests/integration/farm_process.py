"""A real services process on free ports, and scripted robots beside it."""

import json
import os
import signal
import socket
import ssl
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import numpy as np
import safetensors.numpy

from api_schemas.policy import LAYOUTS, canonical_json, policy_digest
from tests.integration.forked import Forked

ROOT = Path(__file__).parents[2]
PATIENCE_S = 120
"""So long anything that has to come is waited for. It says nothing of how soon it comes: machines stall, and are slow."""
OFFER_TIMEOUT_S = 30
"""A robot on a machine that stalls has not failed; one whose process is gone is known to be at once, whatever this is."""


def free_port():
    return free_ports(1)[0]


def free_ports(count):
    """All held at the same time: one that is free again may be drawn again."""
    with ExitStack() as until_all_are_known:
        taken = [until_all_are_known.enter_context(socket.socket()) for _ in range(count)]
        for each in taken:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in taken]


def sha256(content):
    import hashlib

    return hashlib.sha256(content).hexdigest()


def small_policy(layout="rrc2022-push", scale=0.1, width=8, seed=0):
    """Random weights that fit a layout: (weights, manifest)."""
    manifest = LAYOUTS[layout]
    rng = np.random.default_rng(seed)
    tensors = {
        "layer0.weight": rng.normal(0, scale, (width, manifest.observation_size)).astype(np.float32),
        "layer0.bias": rng.normal(0, scale, width).astype(np.float32),
        "layer1.weight": rng.normal(0, scale, (9, width)).astype(np.float32),
        "layer1.bias": rng.normal(0, scale, 9).astype(np.float32),
        "torque_limit_nm": np.full(9, 0.397, np.float32),
    }
    return safetensors.numpy.save(tensors), manifest


class Services:
    """A running services process with its clients."""

    def __init__(self, data, *, host="127.0.0.1", link="tcp", through=(), **settings):
        """``host`` and ``link``: where it listens, and whether the bus is guarded; ``through`` comes before the command."""
        self.data, self.host, self.through = Path(data), host, through
        settings = {"offer_timeout_s": OFFER_TIMEOUT_S} | settings
        self.settings = {f"TRIFARM_{name.upper()}": str(value) for name, value in settings.items()}
        self.port, self.bus_port = free_ports(2)
        scheme = "https" if "tls_key" in settings else "http"
        self.api, self.bus = f"{scheme}://{host}:{self.port}", f"{link}/{host}:{self.bus_port}"
        self.verify = scheme == "https" and ssl.create_default_context(cafile=settings["tls_certificate"])
        self.robots, self.clients = {}, []
        self.process = None
        self.tokens: dict[str, str] = {}
        self.errors = self.data.parent / f"{self.data.name}-stderr.txt"

    def start(self):
        arguments = ["serve", "--data", str(self.data), "--host", self.host, "--port", str(self.port), "--bus", self.bus]
        environment = {name: value for name, value in os.environ.items() if not name.startswith("TRIFARM_")}
        environment |= self.settings
        if self.through:
            with self.errors.open("ab") as errors:
                command = [*self.through, sys.executable, "-m", "services", *arguments]
                self.process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=errors, stderr=errors)
        else:
            self.process = Forked("services.__main__", arguments, cwd=ROOT, env=environment, errors=self.errors)
        until(self._healthy, PATIENCE_S, "the services to be healthy")
        if not self.tokens:
            given = [self.settings.get(f"TRIFARM_{name}_TOKEN") for name in ("ADMIN", "ROBOT")]
            made = self.data / "tokens.json"
            self.tokens = json.loads(made.read_text()) if made.exists() else dict(zip(("admin", "robot"), given, strict=True))
        self.admin = self.client(self.tokens["admin"])
        return self

    def _healthy(self):
        assert self.process.poll() is None, self.errors.read_text()
        try:
            return httpx.get(f"{self.api}/healthz", verify=self.verify).status_code == 200
        except httpx.TransportError:
            return False

    def client(self, token):
        told = {"headers": {"Authorization": f"Bearer {token}"}, "timeout": PATIENCE_S, "verify": self.verify}
        client = httpx.Client(base_url=self.api, **told)
        self.clients.append(client)
        return client

    def robot_client(self, name):
        """A client that speaks for one robot."""
        joined = self.client(self.tokens["robot"]).post(f"/v1/robots/{name}/token")
        assert joined.status_code == 200, joined.text
        return self.client(joined.json()["secret"])

    def start_robot(self, name, **options):
        flags = [part for key, value in options.items() for part in _flag(key, value)]
        environment = os.environ | {"TRIFARM_ROBOT_TOKEN": self.tokens["robot"]}
        if name in self.robots:
            self.robots[name].wait(PATIENCE_S)
        arguments = [name, "--api", self.api, *(["--bus", self.bus] if self.bus else []), *flags]
        self.robots[name] = Forked("tests.integration.scripted_robot", arguments, cwd=ROOT, env=environment)
        return self.robots[name]

    def start_robots(self, count, **options):
        for number in range(count):
            self.start_robot(f"robot-{number}", **options)
        until(lambda: self.robots_in("idle") == count, PATIENCE_S, f"{count} idle robots")

    def robots_in(self, *states):
        return sum(robot["state"] in states for robot in self.admin.get("/v1/robots").json()["robots"])

    def upload(self, weights, manifest, client=None, filename="weights.safetensors"):
        digest = policy_digest(sha256(weights), manifest)
        return (client or self.admin).put(
            f"/v1/policies/{digest}",
            files={"weights": (filename, weights)},
            data={"manifest": canonical_json(manifest)},
        )

    def policy(self, client=None):
        answer = self.upload(*small_policy(), client=client)
        assert answer.status_code in (200, 201), answer.text
        return answer.json()["digest"]

    def submit(self, policy, client=None, headers=None, **more):
        body = {"policy": policy, "task": "push", "trials": 4, "seed": 1} | more
        return (client or self.admin).post("/v1/jobs", json=body, headers=headers)

    def identify(self, client=None, headers=None, **more):
        return (client or self.admin).post("/v1/identifications", json={"robot": "any"} | more, headers=headers)

    def job(self, job_id):
        return self.admin.get(f"/v1/jobs/{job_id}").json()

    def wait_for_end(self, job_id, seconds=PATIENCE_S):
        until(lambda: self.job(job_id)["state"] in ("succeeded", "failed", "cancelled"), seconds, f"the end of {job_id}")
        return self.job(job_id)

    def cpu_s(self):
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def stop(self, number=signal.SIGTERM):
        """It has to end by itself; one that is ended since it hung says where it stood."""
        self.process.send_signal(number)
        status = self.process.wait(PATIENCE_S)
        assert status == 0, f"the services ended with status {status}: {self.errors.read_text()[-5000:]}"
        return status

    def close(self):
        for robot in self.robots.values():
            robot.terminate()
        for robot in self.robots.values():
            try:
                robot.wait(5)
            except subprocess.TimeoutExpired:
                robot.kill()
                robot.wait()
        if self.process is not None and self.process.poll() is None:
            self.stop()
        for client in self.clients:
            client.close()


def _flag(key, value):
    flag = "--" + key.replace("_", "-")
    return [flag] if value is True else [flag, str(value)]


def is_stopped(process):
    """Whether a signal has made it stand still."""
    return Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"


def until(condition, seconds, what):
    ends = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < ends, f"waited {seconds} s for {what}"
        time.sleep(0.03)


@contextmanager
def services(data, **settings):
    running = Services(data, **settings)
    try:
        yield running.start()
    finally:
        running.close()
