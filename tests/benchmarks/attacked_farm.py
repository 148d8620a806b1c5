"""What a robot loses while another robot's policy attacks: ``python -m tests.benchmarks.attacked_farm --out FILE``.

A real farm of two robots. One trial of the reference policy runs with the other robot idle, and again while that robot runs one
hostile trial after the other; both kinds in turns, for each attack. Compared are the medians of the wall time of a control step
and of the CPU time that the robot itself spends on one; only on a machine with nothing else to do does the former say something.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from statistics import median

import httpx

from tests.benchmarks.attacking_robot_policy import NAMES, hostile_graph
from tests.end_to_end.farm import Farm

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "sim_backend/training/reference_policies/push.safetensors"
HOSTILE_TRIALS = 200
LIMIT = 1.1
REPLACE = """
import subprocess

_start = subprocess.Popen.__init__


def _started(self, command, *rest, **named):
    if isinstance(command, list):
        attacking = {"robot_farm.policy.jailed_policy": "tests.benchmarks.attacking_robot_policy"}
        command = [attacking.get(each, each) for each in command]
    _start(self, command, *rest, **named)


subprocess.Popen.__init__ = _started
"""
"""Lies as ``sitecustomize`` where the farm's own processes look for modules; policy processes get no such path."""


class AttackedFarm:
    """The farm and its API; two robots."""

    def __init__(self, folder: Path) -> None:
        (folder / "replaced").mkdir(parents=True)
        (folder / "replaced" / "sitecustomize.py").write_text(REPLACE)
        self.farm = Farm(folder / "farm", robots=2, more=("--physics", "nominal"))
        self.farm.env["PYTHONPATH"] = os.pathsep.join((str(folder / "replaced"), str(ROOT)))
        self._folder = folder

    def __enter__(self) -> "AttackedFarm":
        self.farm.__enter__()
        settings = json.loads((self.farm.folder / "home" / "settings.json").read_text())
        headers = {"Authorization": f"Bearer {settings['token']}"}
        self._api = httpx.Client(base_url=settings["url"], headers=headers, timeout=60)
        self.reference = self._policy(REFERENCE)
        self.hostile = {}
        for name in NAMES:
            graph = hostile_graph(self._folder / f"{NAMES[name]}.onnx", name)
            self.hostile[name] = self._policy(graph, "rrc2022-push")
        self.trial(self.reference, seed=1)  # once, so that nothing is done for the first time later
        self.trial(self.reference, seed=2)
        return self

    def __exit__(self, *ended) -> None:
        self._api.close()
        self.farm.__exit__(*ended)

    def _policy(self, weights: Path, layout: str | None = None) -> str:
        job = self.farm.json(
            "submit", str(weights), "--task", "reach", "--trials", "1", *(["--layout", layout] if layout else [])
        )
        self.farm.run("watch", job["job_id"], code=None)
        return job["policy"]

    def submit(self, policy: str, task: str, trials: int, seed: int) -> str:
        body = {"policy": policy, "task": task, "trials": trials, "seed": seed}
        answer = self._api.post("/v1/jobs", json=body)
        assert answer.status_code == 201, answer.text
        return answer.json()["job_id"]

    def trial(self, policy: str, seed: int, beside: str | None = None) -> dict[str, float | dict]:
        """One trial of 15 simulated seconds, with hostile trials on the other robot if asked; times in ms for a control step."""
        before = {each["robot"]: cpu_s(each["pid"]) for each in self._robots()}
        job = self.submit(policy, "push", 1, seed)
        attack = None if beside is None else self.submit(beside, "push", HOSTILE_TRIALS, seed)
        row = self._report(job)["per_trial"][0]
        pid = next(each["pid"] for each in self._robots() if each["robot"] == row["robot"])
        spent_s, outcome = cpu_s(pid) - before[row["robot"]], row["outcome"]
        steps = outcome["measures"]["control_steps"]
        kinds = {} if attack is None else self._stopped(attack)
        assert outcome["fault"] == "none", outcome
        return {"wall_ms": 1e3 * outcome["wall_s"] / steps, "cpu_ms": 1e3 * spent_s / steps, "hostile": kinds}

    def _stopped(self, job: str) -> dict[str, int]:
        """Ends the hostile job; how its trials had ended until then."""
        self._api.post(f"/v1/jobs/{job}/cancel")
        while any(each["state"] == "running" for each in self._robots()):
            time.sleep(0.02)
        trials = self._api.get(f"/v1/jobs/{job}/trials", params={"limit": 200}).json()["trials"]
        return dict(Counter(each["outcome"]["kind"] for each in trials if each["outcome"]))

    def _report(self, job: str) -> dict:
        while (answer := self._api.get(f"/v1/jobs/{job}/report")).status_code != 200:
            time.sleep(0.02)
        return answer.json()

    def _robots(self) -> list[dict]:
        return self._api.get("/v1/robots").json()["robots"]


def cpu_s(pid: int) -> float:
    """CPU time of a process, without its children's."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(farm: AttackedFarm, name: str, pairs: int) -> dict:
    """Calm and attacked trials in turns, with the same seeds."""
    calm, attacked = [], []
    for seed in range(1, pairs + 1):
        calm.append(farm.trial(farm.reference, seed))
        attacked.append(farm.trial(farm.reference, seed, beside=farm.hostile[name]))
    hostile = sum((Counter(each["hostile"]) for each in attacked), Counter())
    found: dict = {"hostile_trials_that_ended": dict(hostile)}
    for time_ms in ("wall_ms", "cpu_ms"):
        one, other = ([round(each[time_ms], 4) for each in rows] for rows in (calm, attacked))
        found |= {f"calm_{time_ms}": one, f"attacked_{time_ms}": other}
        found[f"{time_ms.removesuffix('_ms')}_ratio"] = round(median(other) / median(one), 4)
    return found


def main() -> int:
    """Writes what was measured; ends with 1 where a step takes more than a tenth longer."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=7, help="calm and attacked trials of each attack")
    parser.add_argument("--attack", choices=list(NAMES), action="append", help="only this one; may be repeated")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    document = {"format": "trifarm-attacked-farm/1", "pairs": given.pairs, "cores": os.cpu_count(), "limit": LIMIT}
    document["load_before"] = round(os.getloadavg()[0], 2)
    with tempfile.TemporaryDirectory(prefix="trifarm-attacked-") as name, AttackedFarm(Path(name)) as farm:
        document["attacks"] = {}
        for each in given.attack or NAMES:
            document["attacks"][each] = found = measure(farm, each, given.pairs)
            print(
                f"{each}: wall x{found['wall_ratio']}, CPU x{found['cpu_ratio']}, {found['hostile_trials_that_ended']}",
                flush=True,
            )
    document["load_after"] = round(os.getloadavg()[0], 2)
    given.out.write_text(json.dumps(document, indent=2) + "\n")
    return int(any(each["wall_ratio"] > LIMIT for each in document["attacks"].values()))


if __name__ == "__main__":
    sys.exit(main())
