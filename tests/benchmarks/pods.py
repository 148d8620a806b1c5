"""Robots as pods: ended at any moment of their trials, and as many as the queue wishes.

    python -m tests.benchmarks.pods ends --out results/pods-ends.json [--trials 100] [--seed 28]
    python -m tests.benchmarks.pods scaling --out results/pods-scaling.json

``ends`` sends SIGTERM to real robots, each a supervisor of its own as a pod has it, at moments that are drawn, and starts them
anew, until a job is done. ``scaling`` has the number of scripted robots follow ``trifarm_robots_wished`` as KEDA and Kubernetes
would have it follow by ``deploy/kubernetes-scaled/scaledobject.yaml``, ten times faster than there, while jobs come and end; a
robot that has to go is drained first.
"""

import argparse
import json
import math
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import yaml

from api_schemas.trial import AttemptState
from tests.integration.farm_process import ROOT, Services, services

SCALED_OBJECT = ROOT / "deploy/kubernetes-scaled/scaledobject.yaml"
FASTER = 10.0
TOLERANCE = 0.1
"""Kubernetes leaves the number as it is where the metric is as near as this to what is wanted."""
LOADS = ((0.0, 40), (12.0, 160), (16.0, 80), (60.0, 8))
"""When jobs of so many trials are submitted, s."""
TRIAL_S = 1.0
ENDS_AFTER_S = (0.2, 4.0)
DRAIN_S = 60.0


@dataclass
class Autoscaler:
    """How many replicas KEDA and the horizontal pod autoscaler want, by the ``spec`` of a ScaledObject; times in its seconds."""

    spec: dict[str, Any]
    replicas: int
    _wanted: list[tuple[float, int]] = field(default_factory=list)
    _were: list[tuple[float, int]] = field(default_factory=list)

    def look(self, now_s: float, metric: float) -> int:
        """The replicas from now on; ``metric`` is what the query gave."""
        (trigger,) = self.spec["triggers"]
        ratio = metric / (float(trigger["metadata"]["threshold"]) * max(self.replicas, 1))
        wanted = self.replicas if abs(ratio - 1.0) <= TOLERANCE else math.ceil(ratio * max(self.replicas, 1) - 1e-9)
        wanted = min(max(wanted, self.spec["minReplicaCount"]), self.spec["maxReplicaCount"])
        behavior = self.spec["advanced"]["horizontalPodAutoscalerConfig"]["behavior"]
        self._wanted.append((now_s, wanted))
        self._were.append((now_s, self.replicas))
        least = min(self._since(self._wanted, now_s, behavior["scaleUp"]["stabilizationWindowSeconds"]))
        most = max(self._since(self._wanted, now_s, behavior["scaleDown"]["stabilizationWindowSeconds"]))
        if self.replicas < least:
            self.replicas = min(least, max(self._bounds(now_s, behavior["scaleUp"]["policies"], 1)))
        elif self.replicas > most:
            self.replicas = max(most, min(self._bounds(now_s, behavior["scaleDown"]["policies"], -1)))
        return self.replicas

    def _bounds(self, now_s: float, policies: list[dict[str, Any]], way: int) -> list[int]:
        """How far each policy lets the number go from what it was at the beginning of the policy's period."""
        bounds = []
        for policy in policies:
            were = self._since(self._were, now_s, policy["periodSeconds"])[0]
            step = policy["value"] if policy["type"] == "Pods" else math.ceil(were * policy["value"] / 100)
            bounds.append(were + way * step)
        return bounds

    @staticmethod
    def _since(kept: list[tuple[float, int]], now_s: float, window_s: float) -> list[int]:
        return [value for at_s, value in kept if at_s >= now_s - window_s]


def wished(farm: Services) -> float:
    """What the metric says."""
    found = re.search(r"^trifarm_robots_wished (\S+)$", httpx.get(f"{farm.api}/metrics").text, re.MULTILINE)
    assert found is not None, "the services have the metric"
    return float(found[1])


def scaling() -> dict[str, Any]:
    """Jobs that come, robots that follow."""
    spec = yaml.safe_load(SCALED_OBJECT.read_text())["spec"]
    spec["maxReplicaCount"] = 24  # scripted robots are processes, too
    rows: list[tuple[int, float, int]] = []
    with tempfile.TemporaryDirectory(prefix="trifarm-pods-") as folder, services(Path(folder) / "farm") as farm:
        policy, scaler, loads, jobs = farm.policy(), Autoscaler(spec, 1), list(LOADS), []
        farm.start_robots(1, trial_s=TRIAL_S)
        began_s = time.monotonic()
        while loads or len(jobs) != sum(farm.job(job)["state"] == "succeeded" for job in jobs) or scaler.replicas > 1:
            now_s = time.monotonic() - began_s
            while loads and loads[0][0] <= now_s:
                jobs.append(farm.submit(policy, trials=loads.pop(0)[1], seed=len(jobs)).json()["job_id"])
            metric = wished(farm)
            follow(farm, scaler.look(FASTER * now_s, metric))
            rows.append((round(FASTER * now_s), metric, scaler.replicas))
            print(rows[-1], flush=True)
            time.sleep(max(0.0, spec["pollingInterval"] / FASTER - (time.monotonic() - began_s - now_s)))
        counts = [farm.job(job) for job in jobs]
        return {
            "faster": FASTER,
            "trials": sum(each["trials"] for each in counts),
            "done": sum(each["trials_done"] for each in counts),
            "platform_faults": sum(each["platform_faults"] for each in counts),
            "most_robots": max(replicas for _, _, replicas in rows),
            "s_wished_replicas": [f"{at_s} {wished_then:.0f} {replicas}" for at_s, wished_then, replicas in rows],
        }


def follow(farm: Services, replicas: int) -> None:
    """So many robots, the first ones; those that go are drained before, as a pod's robot drains itself."""
    there = {name for name, robot in farm.robots.items() if robot.poll() is None}
    wanted = {f"robot-{number}" for number in range(replicas)}
    for name in sorted(wanted - there):
        farm.admin.post(f"/v1/robots/{name}/resume")
        farm.start_robot(name, trial_s=TRIAL_S)
    for name in sorted(there - wanted):
        state = next(each for each in farm.admin.get("/v1/robots").json()["robots"] if each["robot"] == name)
        if state["state"] != "draining":
            farm.admin.post(f"/v1/robots/{name}/drain")
        elif state.get("trial_id") is None:
            farm.robots[name].terminate()


def ends(trials: int, seed: int) -> dict[str, Any]:
    """Robots that are asked to end while they work."""
    rng, codes, found_in, took_s = random.Random(seed), Counter[int](), Counter[str](), []
    with tempfile.TemporaryDirectory(prefix="trifarm-pods-") as folder, services(Path(folder) / "farm") as farm:
        job = farm.submit(farm.policy(), trials=trials, seed=seed).json()["job_id"]
        pods = [pod(farm, number, Path(folder)) for number in range(2)]
        try:
            while farm.job(job)["state"] not in ("succeeded", "failed"):
                number = len(took_s) % len(pods)
                time.sleep(rng.uniform(*ENDS_AFTER_S))
                began_s = time.monotonic()
                found_in[_state(farm, number)] += 1
                pods[number].send_signal(signal.SIGTERM)
                codes[pods[number].wait(DRAIN_S + 30)] += 1
                took_s.append(time.monotonic() - began_s)
                pods[number] = pod(farm, number, Path(folder))
        finally:
            for each in pods:
                each.terminate()
                each.wait(DRAIN_S + 30)
        found, rows = farm.job(job), farm.admin.get(f"/v1/jobs/{job}/trials", params={"limit": 200}).json()["trials"]
        return {
            "seed": seed,
            "trials": trials,
            "done": found["trials_done"],
            "platform_faults": found["platform_faults"],
            "attempts": dict(Counter(_how(each) for row in rows for each in row["attempts"])),
            "lost_at_the_end": farm.admin.get("/v1/status").json()["robots_by_state"]["lost"],
            "pods_ended": len(took_s),
            "in_the_state": dict(found_in),
            "exit_codes": dict(codes),
            "longest_end_s": round(max(took_s, default=0.0), 2),
        }


def _state(farm: Services, number: int) -> str:
    """What the farm says of a robot."""
    robots = {each["robot"]: each["state"] for each in farm.admin.get("/v1/robots").json()["robots"]}
    return robots.get(f"robot-{number}", "not there yet")


def _how(attempt: dict[str, Any]) -> str:
    is_done = attempt["state"] == AttemptState.ACCEPTED
    return attempt["state"] if is_done else f"{attempt['state']}: {re.sub('robot-[0-9]+', 'robot', attempt['reason'])}"


def pod(farm: Services, number: int, folder: Path) -> subprocess.Popen:
    """A robot as its pod has it."""
    flags = {"robots": 1, "first": number, "api": farm.api, "bus": farm.bus, "physics": "nominal", "drain-s": DRAIN_S}
    flags |= {"data": str(folder / f"pod-{number}")}
    command = [sys.executable, "-m", "robot_farm", *(part for name, value in flags.items() for part in (f"--{name}", str(value)))]
    with (folder / "robots.log").open("ab") as said:
        environment = os.environ | {"TRIFARM_ROBOT_TOKEN": farm.tokens["robot"]}
        return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=said, stderr=said)


def main() -> None:
    """Does what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("ends", "scaling"))
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--seed", type=int, default=28)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    found = scaling() if asked.what == "scaling" else ends(asked.trials, asked.seed)
    text = json.dumps(found, indent=1)
    print(text)
    if asked.out is not None:
        asked.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
