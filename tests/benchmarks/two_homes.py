"""A 40-trial push job on PostgreSQL and S3 against the same job on SQLite and a folder: ``--out two-homes.json``.

Two farms with real robots and nominal physics stand side by side, and jobs of the same seeds go to them in turns, so that
whatever else the machine does meets both; the ratio is of the medians within one run. The databases wait for the disk, as in
life. The outcomes of a seed must be the same on both.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

from tests.homes import postgres_server, s3_server, scale_settings
from tests.integration.farm_process import ROOT, services, until

sys.path.insert(0, str(ROOT))
REFERENCE = ROOT / "sim_backend/training/reference_policies/push.safetensors"
ROBOTS, LIMIT = 4, 1.25


@contextmanager
def farm(folder, **homes):
    """Services and real robots that are ready."""
    with services(folder / "farm", **homes) as running:
        flags = ["--robots", str(ROBOTS), "--api", running.api, "--bus", running.bus, "--farm", "farm", "--physics", "nominal"]
        command = [sys.executable, "-m", "robot_farm", *flags, "--data", str(folder / "robots")]
        environment = os.environ | {"TRIFARM_ROBOT_TOKEN": running.tokens["robot"]}
        with (folder / "robots.log").open("wb") as said:
            robots = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=said, stderr=said)
        try:
            until(lambda: running.robots_in("idle") == ROBOTS, 120, f"{ROBOTS} robots")
            yield running
        finally:
            robots.terminate()
            robots.wait(20)


def job(running, policy, trials, seed):
    """Seconds from the submission of a job to its report, and the outcomes of its trials."""
    began = time.perf_counter()
    job_id = running.submit(policy, trials=trials, seed=seed).json()["job_id"]
    with running.admin.stream("GET", f"/v1/jobs/{job_id}/events", timeout=600) as events:
        for _ in events.iter_lines():
            pass
    report = running.admin.get(f"/v1/jobs/{job_id}/report").json()
    return time.perf_counter() - began, [row["outcome"]["kind"] for row in report["per_trial"]]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--jobs", type=int, default=3, help="on each farm")
    asked = parser.parse_args()
    from api_schemas.policy import PolicyManifest

    weights, manifest = REFERENCE.read_bytes(), PolicyManifest.model_validate_json(REFERENCE.with_suffix(".json").read_text())
    with tempfile.TemporaryDirectory() as name, postgres_server() as postgres, s3_server() as s3:
        folders = [Path(name) / home for home in ("embedded", "scale")]
        for folder in folders:
            folder.mkdir()
        postgres.make_newest()
        with farm(folders[0]) as embedded, farm(folders[1], **scale_settings(postgres, s3)) as scale:
            policies = [each.upload(weights, manifest).json()["digest"] for each in (embedded, scale)]
            times, cpu_s = ([], []), [each.cpu_s() for each in (embedded, scale)]
            for seed in range(asked.jobs):
                outcomes = []
                for which, running in enumerate((embedded, scale)):
                    took_s, kinds = job(running, policies[which], asked.trials, seed)
                    times[which].append(round(took_s, 3))
                    outcomes.append(kinds)
                assert outcomes[0] == outcomes[1], f"seed {seed} had other outcomes on the other home"
            cpu_s = [round(each.cpu_s() - before, 2) for each, before in zip((embedded, scale), cpu_s, strict=True)]
    ratio = statistics.median(times[1]) / statistics.median(times[0])
    result = {"trials": asked.trials, "robots": ROBOTS, "embedded_s": times[0], "scale_s": times[1], "ratio": round(ratio, 3)}
    result |= {"ratios_of_pairs": [round(b / a, 3) for a, b in zip(*times, strict=True)], "limit": LIMIT, "holds": ratio <= LIMIT}
    result |= {"services_cpu_s": {"embedded": cpu_s[0], "scale": cpu_s[1]}, "same_outcomes": True}
    body = json.dumps(result, indent=2)
    print(body)
    if asked.out:
        asked.out.write_text(body + "\n")


if __name__ == "__main__":
    main()
