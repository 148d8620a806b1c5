"""A push job whose robots are on another host than the services: ``python -m tests.benchmarks.two_hosts --out two-hosts.json``.

The hosts are network namespaces. Robots are real ones, told an address and a token; https, a guarded bus and its access rules lie
between them. Beside the job, robots with a wrong token try to join. The outcomes must be those of the same job on one machine.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

from api_schemas.policy import PolicyManifest
from tests.benchmarks.two_homes import REFERENCE, job
from tests.integration.farm_process import ROOT, services, until
from tests.integration.two_hosts import https_files, two_hosts, why_not


@contextmanager
def robots(farm, count, folder, *, through=(), token=None, physics="nominal", **variables):
    """Real robots; what they say is in the file that is given."""
    command = [*through, sys.executable, "-m", "robot_farm", "--robots", str(count), "--api", farm.api, "--physics", physics]
    environment = os.environ | {"TRIFARM_ROBOT_TOKEN": token or farm.tokens["robot"]} | variables
    said = folder.with_suffix(".log")
    with said.open("wb") as out:
        running = subprocess.Popen([*command, "--data", str(folder)], cwd=ROOT, env=environment, stdout=out, stderr=out)
    try:
        yield said
    finally:
        running.terminate()
        running.wait(20)


def on_one(folder, policy, trials, seed, count):
    """The outcomes where services and robots share a machine and an open bus."""
    with services(folder / "one") as farm, robots(farm, count, folder / "near"):
        until(lambda: farm.robots_in("idle") == count, 300, f"{count} robots")
        return job(farm, farm.upload(*policy).json()["digest"], trials, seed)


def on_two(folder, policy, trials, seed, count):
    """The same between two hosts; also what robots with a wrong token were told, and how many came in."""
    with two_hosts() as hosts:
        https = https_files(folder, hosts.address)
        ca = {"TRIFARM_CA": str(https["tls_certificate"])}
        guarded = {"host": hosts.address, "link": "tls", "through": hosts.services, "bus_robots": 16}
        with services(folder / "two", **guarded, **https) as farm:
            with robots(farm, 2, folder / "strangers", through=hosts.robots, token="trifarm_x_wrong", **ca) as said:
                until(lambda: "token-unknown" in said.read_text(), 300, "the refusal of a wrong token")
            strangers = len(farm.admin.get("/v1/robots").json()["robots"])
            with robots(farm, count, folder / "far", through=hosts.robots, **ca):
                until(lambda: farm.robots_in("idle") == count, 300, f"{count} robots")
                took_s, kinds = job(farm, farm.upload(*policy).json()["digest"], trials, seed)
    return took_s, kinds, strangers


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if (reason := why_not()) is not None:
        sys.exit(f"there can be no two hosts here: {reason}")
    policy = REFERENCE.read_bytes(), PolicyManifest.model_validate_json(REFERENCE.with_suffix(".json").read_text())
    began = time.strftime("%Y-%m-%d", time.gmtime())
    with tempfile.TemporaryDirectory() as name:
        two_s, kinds, strangers = on_two(Path(name), policy, asked.trials, asked.seed, asked.robots)
        one_s, same = on_one(Path(name), policy, asked.trials, asked.seed, asked.robots)
    result = {"date": began, "trials": len(kinds), "robots": asked.robots, "seed": asked.seed, "bus": "tls, access rules"}
    result |= {"outcomes": kinds, "same_outcomes_as_on_one_host": kinds == same, "robots_with_a_wrong_token": strangers}
    result |= {"two_hosts_s": round(two_s, 1), "one_host_s": round(one_s, 1), "load_average": round(os.getloadavg()[0], 1)}
    body = json.dumps(result, indent=2)
    print(body)
    if asked.out:
        asked.out.write_text(body + "\n")


if __name__ == "__main__":
    main()
