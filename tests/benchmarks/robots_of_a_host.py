"""What robots cost the machine that holds them: memory, processor time while they wait, and how soon a fresh farm gives a lease.

    python -m tests.benchmarks.robots_of_a_host --robots 1 4 16 64 --out FILE

For each count it starts a farm in an empty folder, submits a job when the farm says that it is ready, waits for the job's end,
and then looks at the idle robots. Memory is proportional (PSS: a page that n processes share counts 1/n in each) and unique (USS:
what ending the process would free). Robots let nobody but root look into them. To look at another commit, run this file by its
path in a checkout of that commit, with PYTHONPATH there.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean

import httpx

import sim_backend
from tests.end_to_end.farm import TRIFARM, Farm

POLICY = Path(sim_backend.__file__).parent / "training" / "reference_policies" / "push.safetensors"
IDLE_S = 20.0
SETTLE_S = 2.0
LEASE_WITHIN_S = 60.0
JOB_WITHIN_S = 900.0
LOOK_EVERY_S = 0.02
UNFINISHED = ("queued", "running")
LEASED = ("leased", "running")
COLUMNS = {
    "robots": "robots",
    "robot_pss_mb": "PSS/robot MB",
    "robot_uss_mb": "USS/robot MB",
    "policy_pss_mb": "PSS/policy MB",
    "parents_pss_mb": "PSS parents MB",
    "all_pss_mb": "PSS all MB",
    "idle_core_percent": "idle % of a core",
    "ready_s": "up to ready s",
    "first_lease_s": "ready to lease s",
}


@dataclass(frozen=True)
class Cost:
    """Of one farm; memory in MB (2**20 bytes), as the mean over robots or policy processes where it is one process's.

    ``parents`` are the processes that start robots. ``idle_core_percent`` is of all processes of the host together: robots, their
    policy processes, parents. ``first_lease_s`` counts from the moment when the farm says that it is ready, and includes the
    command that submits.
    """

    robots: int
    robot_pss_mb: float
    robot_uss_mb: float
    policy_pss_mb: float
    parents_pss_mb: float
    all_pss_mb: float
    idle_core_percent: float
    ready_s: float
    first_lease_s: float


def cost(robots: int, physics: str, idle_s: float) -> Cost:
    """Run a farm of so many robots, and look.

    Raises:
        PermissionError: this is not root, whom alone robots let look into their memory.
        RuntimeError: the farm gave no lease, or did not end its job.
    """
    with tempfile.TemporaryDirectory() as folder:
        began_s = time.monotonic()
        with Farm(Path(folder), robots=robots, more=("--physics", physics)) as farm:
            ready_s = time.monotonic() - began_s
            first_lease_s = _first_lease(farm, robots)
            time.sleep(SETTLE_S)
            return _looked_at(farm, robots, idle_s, ready_s, first_lease_s)


def _first_lease(farm: Farm, trials: int) -> float:
    """Submit a job, and wait for its end; gives how long the first lease took, in seconds."""
    began_s = time.monotonic()
    command = [*TRIFARM, "submit", str(POLICY), "--task", "push", "--trials", str(trials), "--seed", "1"]
    with subprocess.Popen(command, env=farm.env, stdout=subprocess.DEVNULL), _client(farm) as client:
        _wait(lambda: any(each["state"] in LEASED for each in _robots(client)), LEASE_WITHIN_S, "no lease")
        took_s = time.monotonic() - began_s
    with _client(farm) as client:
        _wait(lambda: _job(client)["state"] not in UNFINISHED, JOB_WITHIN_S, "the job did not end")
    return took_s


def _looked_at(farm: Farm, count: int, idle_s: float, ready_s: float, first_lease_s: float) -> Cost:
    with _client(farm) as client:
        robots = [each["pid"] for each in _robots(client)]
    policies = [child for robot in robots for child in _children(robot)]
    supervisor = _parent(robots[0])
    parents = [supervisor, *(child for child in _children(supervisor) if child not in robots)]
    everybody = [*robots, *policies, *parents]
    before_s, began_s = sum(map(_cpu_s, everybody)), time.monotonic()
    time.sleep(idle_s)
    percent = 100.0 * (sum(map(_cpu_s, everybody)) - before_s) / (time.monotonic() - began_s)
    memory = {pid: memory_mb(pid) for pid in everybody}

    def pss_mb(pids: Iterable[int]) -> list[float]:
        return [memory[pid][0] for pid in pids]

    return Cost(
        robots=count,
        robot_pss_mb=mean(pss_mb(robots)),
        robot_uss_mb=mean(memory[pid][1] for pid in robots),
        policy_pss_mb=mean(pss_mb(policies)),
        parents_pss_mb=sum(pss_mb(parents)),
        all_pss_mb=sum(pss_mb(everybody)),
        idle_core_percent=percent,
        ready_s=ready_s,
        first_lease_s=first_lease_s,
    )


def _client(farm: Farm) -> httpx.Client:
    settings = json.loads((farm.folder / "home" / "settings.json").read_text())
    return httpx.Client(base_url=settings["url"], headers={"Authorization": f"Bearer {settings['token']}"}, timeout=30.0)


def _job(client: httpx.Client) -> dict:
    return client.get("/v1/jobs").json()["jobs"][0]


def _robots(client: httpx.Client) -> list[dict]:
    return client.get("/v1/robots").json()["robots"]


def _wait(happened: Callable[[], bool], within_s: float, otherwise: str) -> None:
    give_up_s = time.monotonic() + within_s
    while not happened():
        if time.monotonic() > give_up_s:
            raise RuntimeError(f"{otherwise} within {within_s:g} s")
        time.sleep(LOOK_EVERY_S)


def _children(pid: int) -> list[int]:
    return [int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in (task / "children").read_text().split()]


def _parent(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def _cpu_s(pid: int) -> float:
    """What a process's threads have taken, by the scheduler's own clocks: a tick of 10 ms would be too coarse."""
    taken_ns = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # a thread that has ended
            taken_ns += int((task / "schedstat").read_text().split()[0])
    return taken_ns / 1e9


def memory_mb(pid: int) -> tuple[float, float]:
    """PSS and USS."""
    lines = (line.split() for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:])
    kib = {words[0].rstrip(":"): int(words[1]) for words in lines}
    return kib["Pss"] / 1024, (kib["Private_Clean"] + kib["Private_Dirty"]) / 1024


def table(costs: Iterable[Cost]) -> str:
    """One line a farm."""
    rows = [tuple(COLUMNS.values())]
    rows += [tuple(f"{asdict(each)[name]:.{0 if name == 'robots' else 2}f}" for name in COLUMNS) for each in costs]
    return "\n".join("  ".join(cell.rjust(len(title)) for cell, title in zip(row, rows[0], strict=True)) for row in rows)


def main(arguments: list[str] | None = None) -> None:
    """Measure each count in turn."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.robots_of_a_host", description=__doc__)
    parser.add_argument("--robots", type=int, nargs="+", default=[1, 4, 16, 64])
    parser.add_argument("--physics", default="nominal")
    parser.add_argument("--idle-s", type=float, default=IDLE_S, help="how long idle robots are looked at, in seconds")
    parser.add_argument("--out", type=Path, help="file for the figures as JSON")
    asked = parser.parse_args(arguments)
    costs = [cost(robots, asked.physics, asked.idle_s) for robots in asked.robots]
    print(table(costs))
    if asked.out is not None:
        load = round(os.getloadavg()[0], 1)
        result = {
            "physics": asked.physics,
            "cores": os.cpu_count(),
            "load_average": load,
            "farms": [asdict(each) for each in costs],
        }
        asked.out.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
