"""A real farm for tests: ``trifarm up`` in a folder of its own, spoken to through the command line as a user would."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import httpx

from tests.end_to_end import commands
from tests.stalls import stalls

TRIFARM = [sys.executable, "-m", "client_cli"]
READY_WITHIN_S: float = 180  # the first farm of a checkout compiles, beside whatever else runs


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Farm:
    """Started on entry, stopped on exit; its settings never touch the user's."""

    def __init__(
        self,
        folder: Path,
        *,
        robots: int = 4,
        more: tuple[str, ...] = ("--physics", "nominal"),
        through: tuple[str, ...] = (),
    ) -> None:
        """``through``: a script that becomes the interpreter of the farm."""
        self.folder, self.robots, self.more, self.through = folder, robots, more, through
        self.port = free_port()
        kept = {name: value for name, value in os.environ.items() if not name.startswith("TRIFARM_")}
        self.env = kept | {"TRIFARM_HOME": str(folder / "home")}
        folder.mkdir(parents=True, exist_ok=True)
        self.log = folder / "up.log"

    def __enter__(self) -> "Farm":
        command = [
            sys.executable,
            *self.through,
            *TRIFARM[1:],
            "up",
            "--robots",
            str(self.robots),
            "--data",
            str(self.folder / "data"),
            "--port",
            str(self.port),
        ]
        command += self.more
        with self.log.open("wb") as out:
            self.process = subprocess.Popen(command, env=self.env, stdout=out, stderr=subprocess.STDOUT)
        give_up_s = time.monotonic() + READY_WITHIN_S
        while "The farm is up" not in self.log.read_text():
            if self.process.poll() is not None or time.monotonic() > give_up_s:
                raise AssertionError(f"the farm did not start: {self.log.read_text()[-3000:]}")
            time.sleep(0.05)
        return self

    def __exit__(self, *_) -> None:
        self.stop()

    def stop(self) -> float:
        """End the farm; gives the seconds that took, less those in which the machine stalled."""
        started_s = time.monotonic()
        with stalls() as stalled:
            if self.process.poll() is None:
                self.process.send_signal(signal.SIGTERM)
            self.process.wait(timeout=120)
        return time.monotonic() - started_s - stalled.seconds

    def run(self, *arguments: str, code: int | None = 0) -> str:
        """Standard output of a command; its exit code must be ``code``."""
        done = commands.run(*arguments, env=self.env)
        assert code is None or done.returncode == code, f"{arguments}: exit {done.returncode}: {done.stdout}{done.stderr}"
        return done.stdout

    def json(self, *arguments: str, code: int | None = 0) -> dict:
        return json.loads(self.run(*arguments, "--json", code=code))

    def submit(
        self,
        policy: Path | str,
        *,
        layout: str | None = None,
        task: str = "push",
        trials: int = 4,
        seed: int = 1,
        wait: bool = False,
    ) -> str:
        """The id of a new job."""
        more = ["--layout", layout] if layout else []
        more += ["--wait"] if wait else []
        arguments = ("submit", str(policy), "--task", task, "--trials", str(trials), "--seed", str(seed), *more)
        return self.json(*arguments)["job_id"]

    def report(self, job: str) -> dict:
        """The report, after waiting for the job's end."""
        self.run("watch", job)
        return self.json("report", job)

    def robot_in_mid_trial(self, earliest_s: float = 1.0, latest_s: float = 12.0, within_s: float = 120.0) -> dict:
        """A robot far from both ends of its trial (simulated seconds); asked without the command line, to be quick."""
        settings = json.loads((self.folder / "home" / "settings.json").read_text())
        headers = {"Authorization": f"Bearer {settings['token']}"}
        give_up_s = time.monotonic() + within_s
        with httpx.Client(base_url=settings["url"], headers=headers) as client:
            while time.monotonic() < give_up_s:
                for robot in client.get("/v1/robots").json()["robots"]:
                    if robot["state"] == "running" and earliest_s < (robot["simulated_s"] or 0) < latest_s:
                        return robot
                time.sleep(0.01)
        raise AssertionError("no robot was seen in the middle of a trial")
