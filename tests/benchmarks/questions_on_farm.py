"""How soon a farm decides which of two policies is better: the same question with seed after seed, asked through the API.

    python -m tests.benchmarks.questions_on_farm B.safetensors A.safetensors --task push --seeds 10 --out FILE

It asks the farm that ``TRIFARM_URL`` names, one question at a time, and adds a line to the file for each that is answered: run it
again and it goes on. The summary of all lines is printed at the end.
"""

import argparse
import json
import statistics
from pathlib import Path

from trifarm import Farm

FIRST_SEED = 24_000


def answered(out):
    return [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []


def ask(farm, given, seed):
    asked = {"task": given.task, "seed": seed, "until_known": True, "max_trials": given.max, "against": given.other}
    job = farm.submit(given.policy, **asked)
    report = job.wait()
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
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    done = {row["seed"] for row in answered(given.out)}
    with Farm() as farm:
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
