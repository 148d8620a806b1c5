"""The farm of the compose file, started for real, and what a user asks of it; one at a time on a machine."""

import json
import os
import secrets
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import httpx

from api_schemas.policy import PolicyManifest, canonical_json, policy_digest
from services.joining.authority import USE
from services.signing import FarmKey
from tests.integration.farm_process import ROOT, free_port, sha256, until

PROJECT = "trifarm-tried"
REFERENCE = ROOT / "sim_backend/training/reference_policies/push.safetensors"
LOOK_EVERY_S = 2.0
READY_WITHIN_S, JOB_WITHIN_S = 900, 3000
ENDED = ("succeeded", "failed", "cancelled")
SERVICES = ("postgres", "s3", "router", "api", "dispatcher", "robot")


def why_not():
    """Why the compose file cannot be started here, None if it can."""
    if compose() is None:
        return "neither 'docker compose' nor 'docker-compose' is installed"
    answered = subprocess.run(["docker", "info"], capture_output=True, text=True, check=False)
    return None if answered.returncode == 0 else f"Docker's engine does not answer: {answered.stderr.strip()[-200:]}"


def reference_policy():
    """The weights and the manifest of the policy that is tried."""
    return REFERENCE.read_bytes(), PolicyManifest.model_validate_json(REFERENCE.with_suffix(".json").read_text())


def compose():
    """The command, as plugin or program of its own."""
    if subprocess.run(["docker", "compose", "version"], capture_output=True, check=False).returncode == 0:
        return ["docker", "compose"]
    return ["docker-compose"] if shutil.which("docker-compose") else None


class ComposeFarm:
    """Up on entry, with images that are there already; gone with its volumes on exit."""

    def __init__(
        self, *, robots: int, physics: str, farm_seed: int | None = None, bases: dict[str, str], told: dict[str, str]
    ) -> None:
        """``bases``: the images that are built on; ``told``: settings of the services besides those of the file."""
        self.robots, self.port, self.told = robots, free_port(), told
        self.admin_token = f"trifarm_admin_{secrets.token_hex(24)}"
        self.env = os.environ | bases
        self.env |= {"TRIFARM_ADMIN_TOKEN": self.admin_token, "TRIFARM_ROBOT_TOKEN": f"trifarm_robot_{secrets.token_hex(24)}"}
        farm_key = FarmKey(secrets.token_bytes(32))
        self.env |= {"TRIFARM_FARM_KEY": farm_key.seed.hex(), "TRIFARM_BUS_KEY": farm_key.secret_for(USE).hex()}
        self.env |= {"TRIFARM_KEY": secrets.token_hex(24), "PHYSICS": physics}
        self.env |= {"API_PORT": str(self.port), "COMPOSE_PROJECT_NAME": PROJECT}
        self.env |= {} if farm_seed is None else {"TRIFARM_FARM_SEED": str(farm_seed)}
        headers = {"Authorization": f"Bearer {self.admin_token}"}
        self.http = httpx.Client(base_url=f"http://127.0.0.1:{self.port}", headers=headers, timeout=120)

    def __enter__(self) -> "ComposeFarm":
        self.folder = tempfile.TemporaryDirectory()
        more = {name: {"environment": self.told} for name in ("api", "dispatcher")}
        Path(self.folder.name, "more.json").write_text(json.dumps({"services": more}))
        self.compose("down", "--volumes", check=False)
        began = time.monotonic()
        try:
            self.compose("up", "--detach", "--no-build", "--scale", f"robot={self.robots}")
            until(lambda: self.count("idle") == self.robots, READY_WITHIN_S, f"{self.robots} robots")
        except BaseException:
            print(self.logs())
            self.__exit__()
            raise
        self.ready_s = time.monotonic() - began
        return self

    def __exit__(self, *_) -> None:
        self.http.close()
        self.compose("down", "--volumes", check=False)
        self.folder.cleanup()

    def compose(self, *arguments: str, check: bool = True) -> str:
        files = ("--file", str(ROOT / "docker-compose.yml"), "--file", str(Path(self.folder.name, "more.json")))
        command = [*(compose() or []), *files, *arguments]
        done = subprocess.run(command, env=self.env, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0 or not check, f"{arguments}: {done.stdout}{done.stderr}"
        return done.stdout

    def logs(self) -> str:
        return self.compose("logs", "--no-color", "--tail", "30", check=False)

    def count(self, *states: str) -> int:
        time.sleep(LOOK_EVERY_S)
        try:
            answer = self.http.get("/v1/robots")
        except httpx.TransportError:
            return 0
        return sum(each["state"] in states for each in answer.json()["robots"]) if answer.is_success else 0

    def submit(self, trials: int, seed: int) -> str:
        weights, manifest = reference_policy()
        digest = policy_digest(sha256(weights), manifest)
        form = {"files": {"weights": ("push.safetensors", weights)}, "data": {"manifest": canonical_json(manifest)}}
        answer = self.http.put(f"/v1/policies/{digest}", **form)
        assert answer.is_success, answer.text
        answer = self.http.post("/v1/jobs", json={"policy": digest, "task": "push", "trials": trials, "seed": seed})
        assert answer.is_success, answer.text
        return answer.json()["job_id"]

    def report(self, job: str) -> dict:
        """The report, after waiting for the job's end."""
        until(lambda: self.job(job)["state"] in ENDED, JOB_WITHIN_S, f"the end of {job}")
        answer = self.http.get(f"/v1/jobs/{job}/report")
        assert answer.is_success, f"{self.job(job)}: {answer.text}"
        return answer.json()

    def job(self, job: str) -> dict:
        time.sleep(LOOK_EVERY_S)
        return self.http.get(f"/v1/jobs/{job}").json()

    def kill_a_running_robot(self) -> str:
        """Kills the container of a robot in the middle of a trial, which does not come back; gives the robot's name."""
        until(lambda: self._in_mid_trial() is not None, 600, "a robot in the middle of a trial")
        robot = self._in_mid_trial()
        assert robot is not None
        subprocess.run(["docker", "kill", self._container_of(robot)], check=True, capture_output=True)
        return robot

    def _in_mid_trial(self) -> str | None:
        time.sleep(0.2)
        robots = self.http.get("/v1/robots").json()["robots"]
        return next((each["robot"] for each in robots if 1.0 < (each["simulated_s"] or 0.0) < 10.0), None)

    def _container_of(self, robot: str) -> str:
        for container in self.containers("robot"):
            said = subprocess.run(["docker", "logs", container], capture_output=True, text=True, check=True)
            if f"{robot}: ready" in said.stdout + said.stderr:
                return container
        raise AssertionError(f"no container says that it runs {robot}")

    def containers(self, service: str) -> list[str]:
        """Those that run."""
        return [each for each in self.compose("ps", "-q", service).split() if _inspect(each, "{{.State.Running}}") == "true"]

    def users(self) -> dict[str, int]:
        """The user id of the first process of each program's container."""
        top = {}
        for service in SERVICES:
            pid = _inspect(self.containers(service)[0], "{{.State.Pid}}")
            status = Path(f"/proc/{pid}/status").read_text()
            top[service] = int(next(line for line in status.splitlines() if line.startswith("Uid:")).split()[1])
        return top

    def health(self) -> dict[str, str]:
        """What the engine says of each container that has a health check."""
        form = "{{if .State.Health}}{{.State.Health.Status}}{{else}}no check{{end}}"
        return {service: _inspect(self.containers(service)[0], form) for service in SERVICES}


def _inspect(container, form):
    done = subprocess.run(["docker", "inspect", "--format", form, container], check=True, capture_output=True, text=True)
    return done.stdout.strip()
