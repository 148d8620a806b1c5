"""How a policy fares on nominal robots and on the robots of `real` farms, goal by goal beside its teacher.

    python tests/benchmarks/shipped_policy.py POLICY.safetensors --task lift --out FILE [--trials 200] [--farm-seeds N ...]
    python tests/benchmarks/shipped_policy.py POLICY.safetensors --task lift --out FILE --through-farm 7001 [--trials 24]

Many trials at once (``sim_backend/evaluation.py``) at 1 kHz. On a farm's robots the goals, starts and robots are those of the job
that ``published_experts.py farms`` kept for the published expert (its results lie in ``results``), so that both tried the
same goals on the same robots. Goals on nominal robots are fresh. Pieces are kept as they come, and kept ones are not redone. With
``--through-farm`` the policy is uploaded to a farm of that seed, and one job goes the whole path, with the same goals.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

ROOT = Path(__file__).parent.parent.parent
TEACHER = ROOT / "results" / "published-experts-farms.json"
FIRST_FRESH_SEED = 60_000_000
PIECE = 40
POLL_S = 10.0
TASKS_OF_EXPERTS = ("push", "lift")


def piece(policy, task: str, farm: str, trials: range, threads: int, physics_step_s: float) -> list[bool]:
    """Success of some of the trials on one farm, or on nominal robots."""
    from services.jobs.order import trial_seed
    from sim_backend.effects.physics import Physics
    from sim_backend.evaluation import evaluate
    from sim_backend.tasks import TASKS
    from tests.benchmarks.published_experts import JOB_SEED, drawn_robot

    physics, seeds = None, [FIRST_FRESH_SEED + index for index in trials]
    if farm != "nominal":
        names = json.loads(TEACHER.read_text())[farm][task]["robot"]
        robots = {name: drawn_robot(int(farm), name, {}) for name in sorted(set(names))}
        physics, seeds = (
            Physics.stack([robots[names[index]] for index in trials]),
            [trial_seed(JOB_SEED, index) for index in trials],
        )
    noise = np.array([JOB_SEED * 100_000 + index for index in trials], dtype=float)
    settings = {"threads": threads, "physics_step_s": physics_step_s}
    return evaluate(policy, policy.manifest, TASKS[task], seeds, physics=physics, noise_seeds=noise, **settings).success.tolist()


def through_farm(policy: Path | str, task: str, farm_seed: str, trials: int, robots: int) -> dict:
    """Success of each trial of one job on a farm of `real` robots, asked for and reported through its API."""
    from tests.benchmarks.published_experts import JOB_SEED
    from tests.end_to_end import farm as of_farm

    of_farm.READY_WITHIN_S = 900  # other work may have the cores
    more = ("--physics", "real", "--farm-seed", farm_seed, "--reset", "placement")
    with tempfile.TemporaryDirectory() as folder, of_farm.Farm(Path(folder), robots=robots, more=more) as farm:
        job, report = farm.submit(policy, task=task, trials=trials, seed=JOB_SEED), {}
        while "per_trial" not in report:
            time.sleep(POLL_S)
            report = json.loads(farm.run("report", job, "--json", code=None) or "{}")
    rows = sorted(report["per_trial"], key=lambda row: row["trial"])
    return {
        "trials": trials,
        "success": [row["outcome"]["kind"] == "succeeded" for row in rows],
        "robot": [row["robot"] for row in rows],
        **{key: report[key] for key in ("success_rate", "interval_80", "platform_faults", "between_robots")},
    }


def summary(kept: dict, task: str) -> dict:
    """Rates with 80 % intervals, and over all farms the difference to the published expert, paired goal by goal."""
    from tests.benchmarks.published_experts import difference_interval

    teacher, found = json.loads(TEACHER.read_text()), {}
    for farm, success in kept.items():
        interval = binomtest(sum(success), len(success)).proportion_ci(0.8, method="wilson")
        found[farm] = {"trials": len(success), "rate": float(np.mean(success)), "interval_80": [interval.low, interval.high]}
        if farm != "nominal":
            found[farm]["teacher"] = float(np.mean(teacher[farm][task]["success"][: len(success)]))
    farms = [farm for farm in kept if farm != "nominal"]
    taught = {farm: teacher[farm][task]["success"] for farm in farms}
    if farms:
        trials = min(len(kept[farm]) for farm in farms)
        own, shown = (np.array([of[farm][:trials] for farm in farms], float) for of in (kept, taught))
        robots, apart = [np.array(teacher[farm][task]["robot"][:trials]) for farm in farms], own - shown
        interval = difference_interval(apart, robots, np.random.default_rng(1))
        found["difference"] = {"farms": farms, "goals": trials, "mean": float(apart.mean()), "interval_95": list(interval)}
    return found


def main() -> int:
    """Run, print and keep."""
    from sim_backend.training.export import read_policy

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", type=Path)
    parser.add_argument("--task", default="lift", choices=["push", "lift", "reach"])
    parser.add_argument("--out", type=Path, required=True, help="results, also of runs before")
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--farm-seeds", nargs="+", default=["7001", "7002", "7003"])
    parser.add_argument("--through-farm", metavar="SEED")
    parser.add_argument("--robots", type=int, default=8, help="of that farm; the goals of the kept jobs are those of 8")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--physics-step", type=float, default=0.001, help="s; 0.004 is a quarter of the work and less exact")
    given = parser.parse_args()
    settings = {"policy": given.policy.name, "task": given.task, "physics_step_s": given.physics_step}
    kept = json.loads(given.out.read_text()) if given.out.exists() else settings | {"success": {}}
    if {key: kept[key] for key in settings} != settings:
        parser.error(
            f"{given.out} holds results of {kept['policy']}, {kept['task']}, {kept['physics_step_s']} s; give another --out"
        )
    if given.through_farm:
        found = through_farm(given.policy, given.task, given.through_farm, given.trials, given.robots)
        kept.setdefault("farms", {})[given.through_farm] = found
        given.out.write_text(json.dumps(kept) + "\n")
        print(json.dumps(found, indent=2))
        return 0
    if given.task not in TASKS_OF_EXPERTS:
        parser.error(f"there is no published expert for {given.task}; give --through-farm")
    policy = read_policy(given.policy)
    for first in range(0, given.trials, PIECE):
        for farm in ("nominal", *given.farm_seeds):
            success = kept["success"].setdefault(farm, [])
            if len(success) > first:
                continue
            trials = range(first, min(first + PIECE, given.trials))
            success += piece(policy, given.task, farm, trials, given.threads, given.physics_step)
            kept["summary"] = summary(kept["success"], given.task)
            given.out.write_text(json.dumps(kept) + "\n")
            print(f"{farm}: {np.mean(success):.3f} of {len(success)} trials", flush=True)
    print(json.dumps(kept["summary"], indent=2))
    return 0


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    sys.exit(main())
