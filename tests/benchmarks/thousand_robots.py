"""A hundred and a thousand robots: what they cost the services, and how long a status takes while they come.

    python -m tests.benchmarks.thousand_robots --label after --out results/thousand-robots.json

Scripted robots come within ten seconds, over a real bus and the API, while somebody asks for the status ten times a second;
then they are at rest, each heard once a second, and nobody asks for anything; then they work, and the status is asked for. The
processor's time is that of the services' processes, and apart from it that of the database; the robots are a process of their
own, whose time does not count. ``--checkout`` measures the services of another checkout with the same robots, and one file keeps
what several runs found, by label.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path

import httpx
from prometheus_client.parser import text_string_to_metric_families

from tests.benchmarks.asking import Asking, spread_ms
from tests.benchmarks.machine import kind
from tests.homes import now, postgres_server
from tests.integration.farm_process import ROOT, Services, free_ports, until

SETTLE_S, ASK_EVERY_S, STATUS = 5.0, 0.1, "/v1/status"
TRIALS_PER_S = 100
"""What the robots could do together if leases cost nothing."""
JOB_TRIALS, JOBS = 1000, 12
HOMES = ("embedded", "scale", "three")
"""SQLite; PostgreSQL; PostgreSQL with a router, an API and three dispatchers, each a process of its own."""
NO_LIMITS = {"requests_per_s": 0, "anonymous_requests_per_s": 0, "robot_requests_per_s": 0}
TOKENS = {"admin_token": "trifarm_swarm-admin_" + "a" * 40, "robot_token": "trifarm_swarm-robot_" + "r" * 40}
KILL_EVERY_S = 30.0


def cpu_s(pids):
    """Seconds of the processor that the processes, and what they started and waited for, have used."""
    used = 0
    for pid in pids:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        used += sum(map(int, fields[11:15]))
    return used / os.sysconf("SC_CLK_TCK")


def family(pid):
    """A process and all that it started; nothing where there is none."""
    found = [] if pid is None else [pid]
    for each in found:
        try:
            found += map(int, Path(f"/proc/{each}/task/{each}/children").read_text().split())
        except OSError:
            continue
    return found


def memory_mb(pids):
    """Resident, of all together."""
    pages = sum(int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in pids)
    return round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6)


def figures(asking):
    """Milliseconds of the status's answers."""
    found = spread_ms(asking.took_s[STATUS])
    return {"status_ms": found["median_ms"], "status_p95_ms": found["p95_ms"], "status_max_ms": found["longest_ms"]}


class Farm:
    """The services of one home, and how much of the processor they have used."""

    def __init__(self, services, database_pid, others, asked):
        self.services, self.database_pid, self.others = services, database_pid, others
        self.asked = asked
        """Who counts how long giving leases took, as addresses."""

    def pids(self):
        return [self.services.process.pid, *(each.pid for each in self.others if each.poll() is None)]

    @contextmanager
    def measured(self, into):
        """What a block costs, as shares of one core."""
        pids, began_s = self.pids(), time.monotonic()
        before = cpu_s(pids), cpu_s(family(self.database_pid))
        yield
        took_s, used = time.monotonic() - began_s, cpu_s(pids) - before[0]
        into |= {"cpu": round(used / took_s, 3), "seconds": round(took_s, 1)}
        if self.database_pid:
            into["database_cpu"] = round((cpu_s(family(self.database_pid)) - before[1]) / took_s, 3)


@contextmanager
def farm_of(home, folder, checkout, postgres):
    """The services' processes of a home."""
    settings, others, ports = NO_LIMITS | TOKENS, [], []
    with ExitStack() as stack:
        if home != "embedded":
            settings |= {"database_url": now(postgres.empty())}
        services = Services(folder / "farm", through=("env", "-C", str(checkout or ROOT)), **settings)  # names of settings
        if home == "three":
            services.settings |= {"TRIFARM_DISPATCHES": "false", "TRIFARM_BUS_CONNECT": services.bus}
            others.append(part(stack, services, "router", "--bus", services.bus))
        services.start()
        stack.callback(ended, services.process)
        stack.callback(services.admin.close)
        if home == "three":
            ports = free_ports(3)
            for number, port in enumerate(ports):
                told = (
                    "--data",
                    str(folder / f"dispatcher-{number}"),
                    "--bus-connect",
                    services.bus,
                    "--metrics-port",
                    str(port),
                )
                others.append(part(stack, services, "dispatch", *told))
        asked = [f"http://127.0.0.1:{port}" for port in ports] or [services.api]
        yield Farm(services, None if home == "embedded" else postgres.process.pid, others, asked)


def part(stack, services, *arguments):
    """Another process of the services."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("TRIFARM_")} | services.settings
    without = {"TRIFARM_DISPATCHES", "TRIFARM_BUS_CONNECT"}
    environment = {name: value for name, value in environment.items() if name not in without}
    with services.errors.with_suffix(f".{arguments[0]}").open("ab") as said:
        command = [*services.through, sys.executable, "-m", "services", *arguments]
        running = subprocess.Popen(command, stdout=said, stderr=said, env=environment)
    stack.callback(ended, running)
    return running


def ended(process):
    """Told to stop, and ended if it does not: with a thousand links that takes a while."""
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@contextmanager
def swarm(farm, robots, within_s):
    """The robots, on their way."""
    environment = os.environ | {"TRIFARM_ROBOT_TOKEN": TOKENS["robot_token"]}
    where = ["--api", farm.services.api, "--bus", farm.services.bus]
    how = ["--robots", str(robots), "--within-s", str(within_s), "--trial-s", str(robots / TRIALS_PER_S)]
    command = [sys.executable, "-m", "tests.benchmarks.swarm", *where, *how]
    with subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True) as running:
        try:
            yield running
        finally:
            ended(running)


def status(farm):
    return farm.services.admin.get("/v1/status").json()


def done(farm):
    """Trials whose outcome was accepted."""
    return sum(each["trials_done"] for each in farm.services.admin.get("/v1/jobs", params={"limit": 100}).json()["jobs"])


def claim_ms(farm):
    """How long giving a lease took on average, where the services count that; of several dispatchers those that still live."""
    found = Counter()
    for address in farm.asked:
        try:
            said = httpx.get(f"{address}/metrics", trust_env=False).text
        except httpx.ConnectError:
            continue  # it was killed
        found.update({each.name: each.value for one in text_string_to_metric_families(said) for each in one.samples})
    count = found["trifarm_claim_seconds_count"]
    return round(1e3 * found["trifarm_claim_seconds_sum"] / count, 2) if count else None


def said_by(running):
    """The next line of the swarm."""
    assert running.stdout is not None
    return running.stdout.readline()


def measured(home, robots, within_s, rest_s, work_s, checkout, postgres):
    """One farm with so many robots: while they come, at rest, and at work."""
    found = {"home": home, "robots": robots, "load_before": round(os.getloadavg()[0], 1)}
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        farm = stack.enter_context(farm_of(home, Path(name), checkout, postgres))
        found["memory_mb_alone"], began_s = memory_mb(farm.pids()), time.monotonic()
        with Asking(farm.services, STATUS, every_s=ASK_EVERY_S) as asking, farm.measured(coming := {}):
            running = stack.enter_context(swarm(farm, robots, within_s))
            coming |= json.loads(said_by(running))
            until(lambda: status(farm)["robots_by_state"]["idle"] == robots, 300, f"{robots} idle robots")
        found["coming"] = coming | figures(asking) | {"all_idle_after_s": round(time.monotonic() - began_s, 1)}
        time.sleep(SETTLE_S)
        with farm.measured(rest := {}):
            time.sleep(rest_s)
        found["rest"] = rest | {"memory_mb": memory_mb(farm.pids())}
        found["work"] = worked(farm, robots / TRIALS_PER_S, work_s, stops=home == "three")
        found["robots_afterwards"] = {state: count for state, count in status(farm)["robots_by_state"].items() if count}
        running.send_signal(signal.SIGTERM)
        found |= json.loads(said_by(running))
    return found


def worked(farm, trial_s, work_s, *, stops):
    """Outcomes in a second while more trials wait than can be done; of three dispatchers one is killed now and then."""
    policy = farm.services.policy()
    for seed in range(JOBS):
        answer = farm.services.submit(policy, trials=JOB_TRIALS, seed=seed)
        assert answer.status_code == 201, answer.text
    time.sleep(trial_s + SETTLE_S)
    killed = 0
    with Asking(farm.services, STATUS, every_s=ASK_EVERY_S) as asking, farm.measured(work := {}):
        began_s, before = time.monotonic(), done(farm)
        while (passed_s := time.monotonic() - began_s) < work_s:
            time.sleep(0.5)
            if stops and killed < int(passed_s / KILL_EVERY_S) and len(farm.others) > 2:
                farm.others.pop().kill()
                killed += 1
        outcomes = done(farm) - before
        passed_s = time.monotonic() - began_s
    found = work | figures(asking) | {"trial_s": trial_s, "outcomes_per_s": round(outcomes / passed_s, 1)}
    return found | {"claim_ms": claim_ms(farm), "memory_mb": memory_mb(farm.pids())} | ({"killed": killed} if stops else {})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--label", default="after", help="under which the file keeps what is found; others stay")
    parser.add_argument("--checkout", type=Path, help="whose services are measured; this one's without")
    parser.add_argument("--robots", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--homes", choices=HOMES, nargs="+", default=["embedded", "scale"])
    parser.add_argument("--within-s", type=float, default=10.0, help="in which they come")
    parser.add_argument("--rest-s", type=float, default=20.0)
    parser.add_argument("--work-s", type=float, default=30.0)
    asked = parser.parse_args()
    with postgres_server("-c", "max_connections=200") if set(asked.homes) - {"embedded"} else nullcontext() as postgres:
        for home in asked.homes:
            for robots in asked.robots:
                run = measured(home, robots, asked.within_s, asked.rest_s, asked.work_s, asked.checkout, postgres)
                print(json.dumps(run), flush=True)
                kept = json.loads(asked.out.read_text()) if asked.out.exists() else {"machine": kind(), "runs": {}}
                kept["runs"].setdefault(asked.label, []).append(run)
                asked.out.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
