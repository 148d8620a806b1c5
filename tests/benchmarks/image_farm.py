"""What a whole farm costs whose trackers look at images, beside one of the formula.

``python -m tests.benchmarks.image_farm --out FILE [--trials 4] [--robots 1] [--physics real-images]`` starts one farm after the
other, has each try the same push goals with the reference policy, and keeps for each trial what it achieved and how long it took
by the wall, from its first step to its log. Rates are simulated seconds for each second of the wall on this machine as it was.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from tests import ROOT
from tests.end_to_end import farm as of_farm

POLICY = ROOT / "sim_backend/training/reference_policies/push-adr.safetensors"
TRACKERS = ("images", "pose")
READY_WITHIN_S, SEED = 900, 5


def of_report(report: dict[str, Any]) -> dict[str, Any]:
    """What is kept of a job's report."""
    rows = sorted(report["per_trial"], key=lambda row: row["trial"])
    ran = [row["outcome"] for row in rows if row["outcome"].get("measures")]
    rates = [each["measures"]["simulated_s"] / each["wall_s"] for each in ran]
    return {
        "trials": len(rows),
        "successes": sum(row["outcome"]["kind"] == "succeeded" for row in rows),
        "platform_faults": report["platform_faults"],
        "trackers": report.get("trackers", ["pose"]),
        "error_mm": [round(1000 * each["measures"]["final_position_error_m"], 1) for each in ran],
        "wall_s": [round(each["wall_s"], 1) for each in ran],
        "simulated_s_per_wall_s": round(float(np.median(rates)), 3),
    }


def tried(tracker: str, folder: Path, given: argparse.Namespace) -> dict[str, Any]:
    """One farm, one job, its report, and the load of the machine before and after."""
    of_farm.READY_WITHIN_S = READY_WITHIN_S
    more = ("--physics", given.physics, "--tracker", tracker, "--farm-seed", str(given.farm_seed))
    load = [os.getloadavg()[0]]
    with of_farm.Farm(folder, robots=given.robots, more=more) as farm:
        job, report = farm.submit(POLICY, task="push", trials=given.trials, seed=SEED), {}
        while "per_trial" not in report:
            time.sleep(2.0)
            report = json.loads(farm.run("report", job, "--json", code=None) or "{}")
    return of_report(report) | {"load": [round(each, 1) for each in [*load, os.getloadavg()[0]]]}


def main(arguments: list[str] | None = None) -> int:
    """Run, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=4)
    parser.add_argument("--robots", type=int, default=1)
    parser.add_argument("--physics", default="real-images")
    parser.add_argument("--farm-seed", type=int, default=26)
    parser.add_argument("--trackers", nargs="+", choices=TRACKERS, default=list(TRACKERS))
    given = parser.parse_args(arguments)
    found: dict[str, Any] = {
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
        "cores": os.cpu_count(),
        "robots": given.robots,
    }
    found |= {"physics": given.physics, "farm_seed": given.farm_seed, "policy": POLICY.name, "seed": SEED, "farms": {}}
    for tracker in given.trackers:
        with tempfile.TemporaryDirectory() as folder:
            found["farms"][tracker] = tried(tracker, Path(folder), given)
        given.out.write_text(json.dumps(found, indent=1) + "\n")
        print(json.dumps({tracker: found["farms"][tracker]}), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
