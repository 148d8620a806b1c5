"""The compose file against the embedded home: ``python -m tests.containers.try_compose --bases bases.env --out compose.json``.

The images must have been built (``docker build --target api|robot|s3``), where none can be pulled on stand-ins that
``make_bases.sh`` makes. Each part is written down as soon as it is over, and one that is there already is not done again:

killed   nominal physics, one robot's container killed in the middle of a trial: the job finishes, with the same outcomes as
         the embedded home gives with the same seed
real     robots that differ, the same farm seed, no fault: the same robots and outcomes
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.benchmarks.two_hosts import robots
from tests.containers.compose_farm import ENDED, JOB_WITHIN_S, LOOK_EVERY_S, ComposeFarm, reference_policy, why_not
from tests.integration.farm_process import services, until

ROBOTS, FARM_SEED = 4, 7
PATIENCE = {"TRIFARM_LEASE_S": "60", "TRIFARM_OFFER_TIMEOUT_S": "20", "TRIFARM_MAX_ATTEMPTS": "20"}
"""For machines that have other work: both farms are told so, and no outcome depends on it."""
IN_ORDER = {"TRIFARM_PASS_OVER_S": "3600"}
"""Where robots differ each trial waits for the one that was drawn for it, so that both farms take the same."""
ABSENT = "from importlib.util import find_spec; print(*(m for m in ('torch', 'mujoco', 'numba') if find_spec(m)))"


def killed(bases, trials, seed):
    """A job that outlives one of its robots' containers."""
    with ComposeFarm(robots=ROBOTS, physics="nominal", bases=bases, told=PATIENCE) as farm:
        began = time.monotonic()
        job = farm.submit(trials, seed)
        robot = farm.kill_a_running_robot()
        report = farm.report(job)
        told = {"ready_s": round(farm.ready_s, 1), "job_s": round(time.monotonic() - began, 1), "killed": robot}
        told |= {"user_ids": farm.users(), "health": farm.health(), "state": farm.job(job)["state"]}
    outcomes = [row["outcome"]["kind"] for row in report["per_trial"]]
    told |= {"trials": len(outcomes), "attempts": report["attempts"], "platform_faults": report["platform_faults"]}
    embedded = on_embedded(trials, seed, "nominal", PATIENCE)
    return told | {"outcomes": outcomes, "same_outcomes_as_embedded": measured(report) == measured(embedded)}


def real(bases, trials, seed):
    """Robots that differ: who did which trial, and how it ended, here and there."""
    with ComposeFarm(robots=ROBOTS, physics="real", farm_seed=FARM_SEED, bases=bases, told=PATIENCE | IN_ORDER) as farm:
        report = farm.report(farm.submit(trials, seed))
    embedded = on_embedded(trials, seed, "real", PATIENCE | IN_ORDER, TRIFARM_FARM_SEED=str(FARM_SEED))
    rows = [{"robot": row["robot"], "outcome": row["outcome"]["kind"]} for row in report["per_trial"]]
    told = {"trials": len(rows), "farm_seed": FARM_SEED, "per_trial": rows}
    told["same_robots"] = [row["robot"] for row in rows] == [row["robot"] for row in embedded["per_trial"]]
    told["same_outcomes"] = [row["outcome"] for row in rows] == [row["outcome"]["kind"] for row in embedded["per_trial"]]
    return told | {"same_measures": measured(report) == measured(embedded)}


def on_embedded(trials, seed, physics, told, **variables):
    """The report of the same job in the embedded home: SQLite, a folder, a bus in the services' process."""
    settings = {name.removeprefix("TRIFARM_").lower(): value for name, value in told.items()}
    with (
        tempfile.TemporaryDirectory() as name,
        services(Path(name) / "farm", **settings) as farm,
        robots(farm, ROBOTS, Path(name) / "robots", physics=physics, **variables),
    ):
        until(lambda: time.sleep(LOOK_EVERY_S) or farm.robots_in("idle") == ROBOTS, 900, f"{ROBOTS} robots")
        job = farm.submit(farm.upload(*reference_policy()).json()["digest"], trials=trials, seed=seed).json()["job_id"]
        until(lambda: time.sleep(LOOK_EVERY_S) or farm.job(job)["state"] in ENDED, JOB_WITHIN_S, f"the end of {job}")
        return farm.admin.get(f"/v1/jobs/{job}/report").json()


def measured(report):
    """How each trial ended, with all that was measured of it."""
    return [(row["outcome"]["kind"], row["outcome"]["measures"]) for row in report["per_trial"]]


def api_image():
    """What the API's image weighs, and what of physics and learning is in it."""
    size = subprocess.run(["docker", "image", "inspect", "--format", "{{.Size}}", "trifarm-api"], capture_output=True, check=True)
    command = ["docker", "run", "--rm", "--entrypoint", "python", "trifarm-api", "-c", ABSENT]
    found = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return {"bytes": int(size.stdout), "physics_and_learning_in_it": found}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--bases", type=Path, help="lines of NAME=IMAGE, as make_bases.sh prints them")
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=["killed", "real"])
    asked = parser.parse_args()
    if (reason := why_not()) is not None:
        sys.exit(f"the compose file cannot be started: {reason}")
    bases = dict(line.split("=", 1) for line in asked.bases.read_text().split()) if asked.bases else {}
    result = json.loads(asked.out.read_text()) if asked.out.exists() else {}
    result |= {"seed": asked.seed, "robots": ROBOTS, "api_image": api_image()}
    for name, part in (("killed", killed), ("real", real)):
        if name not in result and asked.only in (None, name):
            result[name] = part(bases, asked.trials, asked.seed)
            result[name]["load_average"] = round(os.getloadavg()[0], 1)
            asked.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
