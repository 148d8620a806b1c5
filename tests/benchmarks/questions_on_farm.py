"""How soon a farm decides which of two policies is better: the same question with seed after seed, asked through the API.

    python -m tests.benchmarks.questions_on_farm B.safetensors A.safetensors --task push --seeds 10 --out FILE

Of two policies of equal rate that differ (``tests/benchmarks/turned_policy.py`` makes the one of the other):

    python -m tests.benchmarks.questions_on_farm turned.onnx push-adr.safetensors --seeds 20 --max 60 --out FILE

It starts a farm of `real` robots, asks one question at a time, and adds a line to the file for each that is answered: run it
again and it goes on. The summary of all lines is printed at the end.
"""

import argparse
import json
import statistics
import tempfile
import time
from pathlib import Path

import httpx

from api_schemas.report import Report, read_report
from tests.end_to_end import farm as of_farm

FIRST_SEED = 24_000
MOST_S = 15.0


def answered(out):
    return [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []


def wait_for(farm, job):
    """The report of a job once it is there; who waits longer asks less often."""
    began_s, settings = time.monotonic(), json.loads((farm.folder / "home" / "settings.json").read_text())
    headers = {"Authorization": f"Bearer {settings['token']}"}
    while '"per_trial"' not in (body := farm.run("report", job, "--json", code=None)):
        told = httpx.get(f"{settings['url']}/v1/jobs/{job}", headers=headers, timeout=60).json()
        if told["state"] in ("failed", "cancelled"):
            raise RuntimeError(f"job {job} has {told['state']}: {told['reason']}")
        time.sleep(min(MOST_S, 1.0 + 0.2 * (time.monotonic() - began_s)))
    return body


def ask(farm, given, seed):
    asked = ("--task", given.task, "--seed", str(seed), "--until-known", "--max", str(given.max), "--against", given.other)
    job = farm.run("submit", given.policy, *asked).split()[0]
    report = read_report(wait_for(farm, job).encode())
    assert isinstance(report, Report) and report.question is not None, "it was asked by --until-known"
    found = report.question
    return {
        "policy": found.policy_name,
        "against": found.against_policy_name,
        "task": given.task,
        "seed": seed,
        "most_goals": given.max,
        "goals": found.goals,
        "successes": found.successes,
        "other_successes": found.other_successes,
        "gained": found.gained,
        "lost": found.lost,
        "same_robot": found.same_robot,
        "uncounted": report.uncounted,
        "verdict": found.verdict,
        "robots": len(report.per_robot),
        "forms": report.forms,
    }


def main():
    parser = argparse.ArgumentParser(description="The same question with seed after seed.")
    parser.add_argument("policy")
    parser.add_argument("other")
    parser.add_argument("--task", default="push")
    parser.add_argument("--max", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--robots", type=int, default=2)
    parser.add_argument("--farm-seed", default="7001")
    parser.add_argument("--keep", type=Path, help="the farm's folder (default: a temporary one)")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    done = {row["seed"] for row in answered(given.out)}
    of_farm.READY_WITHIN_S = 900  # other work may have the cores
    more = ("--physics", "real", "--farm-seed", given.farm_seed)
    with (
        tempfile.TemporaryDirectory() as temporary,
        of_farm.Farm(given.keep or Path(temporary), robots=given.robots, more=more) as farm,
    ):
        for seed in range(FIRST_SEED, FIRST_SEED + given.seeds):
            if seed not in done:
                row = ask(farm, given, seed)
                with given.out.open("a") as lines:
                    lines.write(json.dumps(row) + "\n")
    rows = answered(given.out)
    verdicts = [row["verdict"] for row in rows]
    counts = {verdict: verdicts.count(verdict) for verdict in sorted(set(verdicts))}
    goals = statistics.median(row["goals"] for row in rows)
    print(json.dumps({"questions": len(rows), "median_goals": goals, "verdicts": counts}))


if __name__ == "__main__":
    main()
