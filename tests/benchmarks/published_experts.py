"""How the published experts fare on farms of `real` robots against nominal ones: same goals, same starts.

    python tests/benchmarks/published_experts.py farms --experts FOLDER --out FILE [--farm-seeds 7001 7002 7003] [--trials 200]
    python tests/benchmarks/published_experts.py groups --experts FOLDER --out FILE [--farm-seeds 7001] [--trials 200]
    python tests/benchmarks/published_experts.py band --experts FOLDER --out FILE [--farm-seeds 7003] [--trials 200]

``farms`` submits push and lift jobs to farms of 8 robots through the whole path, with the arena reset by placement, so that
trial k has the same goal and start on every farm. ``groups`` leaves one group of effects out at a time, on the same robots and
goals, with many trials at once (``sim_backend/evaluation.py``). ``band`` lifts on the robots of one farm with some ranges of
``real`` made harder, to show which would bring a rate into the band that was asked for; goals and first choices of robots are
those of the farm's job, and robots keep their place within each range. Results are written as they come, and kept ones are not
redone.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent.parent
TASKS = ("push", "lift")
JOB_SEED = 31
FARM_SEEDS = {"farms": [7001, 7002, 7003], "groups": [7001], "band": [7003]}
ROBOTS = 8
RESAMPLES = 9999
HARDER = {
    "actuation x1.5": {
        "coulomb_friction.torque_nm": (0.03, 0.09),
        "load_friction.coefficient": (0.03, 0.12),
        "torque_constant.error": (-0.12, 0.12),
        "action_delay.delay_s": (0.0015, 0.0045),
    },
    "slippery fingertips": {"fingertip_friction.coefficient": (0.4, 0.8)},
    "more orientation jumps": {"orientation_jumps.probability": (0.005, 0.02)},
    "Coulomb friction x1.5": {"coulomb_friction.torque_nm": (0.03, 0.09)},
}
"""Ranges instead of those of ``real``, which stays as it is: half as much again, a dusty fingertip, a cube hard to tell apart."""


def farm_successes(experts: Path, physics: list[str], trials: int) -> dict[str, dict]:
    """Success of each trial and its robot, by task, on one farm."""
    from tests.end_to_end.farm import Farm

    found = {}
    with tempfile.TemporaryDirectory() as folder:
        more = (*physics, "--reset", "placement")
        with Farm(Path(folder), robots=ROBOTS, more=more) as farm:
            for task in TASKS:
                weights = experts / f"{task}_expert.safetensors"
                job = farm.submit(weights, layout=f"rrc2022-{task}", task=task, trials=trials, seed=JOB_SEED)
                report = farm.report(job)
                rows = sorted(report["per_trial"], key=lambda row: row["trial"])
                found[task] = {
                    "success": [row["outcome"]["kind"] == "succeeded" for row in rows],
                    "robot": [row["robot"] for row in rows],
                    "between_robots": report["between_robots"],
                    "interval_80": report["interval_80"],
                    "platform_faults": report["platform_faults"],
                }
                print(f"{' '.join(physics)} {task}: {np.mean(found[task]['success']):.3f}", flush=True)
    return found


def compared(nominal: dict, real: list[dict]) -> dict[str, dict]:
    """Rates and paired differences over the farms, by task.

    The farms share goals and the nominal trials, so that their pairs are not independent: the difference is averaged over the
    farms for each goal, and its interval comes from resampling goals, and robots within each farm (:func:`difference_interval`).
    """
    summary = {}
    for task in TASKS:
        wins = np.array([farm[task]["success"] for farm in real], dtype=float)
        difference = wins - np.array(nominal[task]["success"], dtype=float)
        robots = [np.array(farm[task]["robot"]) for farm in real]
        summary[task] = {
            "nominal": float(np.mean(nominal[task]["success"])),
            "real": wins.mean(axis=1).tolist(),
            "difference": float(difference.mean(axis=0).mean()),
            "difference_interval_95": list(difference_interval(difference, robots, np.random.default_rng(1))),
            "robots": [_by_robot(farm[task]) for farm in real],
            "variance_between_robots": [farm[task]["between_robots"] for farm in real],
        }
    return summary


def difference_interval(
    difference: np.ndarray, robots: list[np.ndarray], rng: np.random.Generator, resamples: int = RESAMPLES
) -> tuple[float, float]:
    """95 % interval of the mean paired difference, by a bootstrap of goals crossed with robots.

    Each resample draws goals, the same ones for all farms, and within each farm robots, all with replacement; a pair counts as
    often as its goal times as often as its robot was drawn. What belongs to a goal (its difficulty, its one nominal trial) and
    what belongs to a robot is thereby drawn as a whole. Chance in the single trial is counted in both draws, so that the interval
    is rather too wide than too narrow (Owen 2007, "The pigeonhole bootstrap").

    Args:
        difference: success on each farm minus success on the nominal one, shape (farms, goals).
        robots: who ran each goal, names of shape (goals,) for each farm.
        rng: for the resamples.
        resamples: how many.
    """
    goals = difference.shape[1]
    goal_counts = rng.multinomial(goals, np.full(goals, 1 / goals), size=resamples)
    means = np.zeros(resamples)
    for row, names in zip(difference, robots, strict=True):
        known, index = np.unique(names, return_inverse=True)
        counts = goal_counts * rng.multinomial(len(known), np.full(len(known), 1 / len(known)), size=resamples)[:, index]
        means += counts @ row / counts.sum(axis=1) / len(difference)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def _by_robot(found: dict) -> dict[str, float]:
    robots, wins = np.array(found["robot"]), np.array(found["success"], dtype=float)
    return {str(robot): round(float(wins[robots == robot].mean()), 3) for robot in np.unique(robots)}


def group_rates(experts: Path, farm_seed: int, trials: int, kept: dict, out: Path) -> dict:
    """Success with each group of effects left out, on the robots of one farm seed."""
    from robot_farm.hidden_physics import HiddenPhysics, farm_secret
    from sim_backend.effects.catalogue import CATALOGUE
    from sim_backend.effects.effect import Group
    from sim_backend.effects.physics import Physics

    secret = farm_secret(Path(), farm_seed)
    robots = [HiddenPhysics(secret, f"robot-{index}", "real").physics for index in range(ROBOTS)]
    full = Physics.stack([robots[index % ROBOTS] for index in range(trials)])
    left_out = {"nothing": []} | {str(group): [e.name for e in CATALOGUE.values() if e.group is group] for group in Group}
    left_out |= {"everything": list(CATALOGUE)}
    left_out.pop("fault")
    for task in TASKS:
        act, manifest = expert(experts / f"{task}_expert.safetensors", task)
        for name, effects in left_out.items():
            if f"{task} without {name}" not in kept:
                kept[f"{task} without {name}"] = _wins(act, manifest, task, full.without(effects), trials)
                out.write_text(json.dumps(kept) + "\n")
                print(f"{task} without {name}: {np.mean(kept[f'{task} without {name}']):.3f}", flush=True)
    return kept


def band_rates(experts: Path, farm_seed: int, trials: int, kept: dict, out: Path) -> dict:
    """Success in lifting with harder ranges, on the robots, goals and first choices of one farm seed."""
    from services.jobs.order import drawn_order, trial_seed
    from sim_backend.effects.physics import Physics

    names = [f"robot-{index}" for index in range(ROBOTS)]
    order = [drawn_order(JOB_SEED, index, names)[0] for index in range(trials)]
    goals = [trial_seed(JOB_SEED, index) for index in range(trials)]
    act, manifest = expert(experts / "lift_expert.safetensors", "lift")
    for name, harder in ({"real": {}} | HARDER).items():
        if name not in kept:
            robots = {robot: drawn_robot(farm_seed, robot, harder) for robot in names}
            wins = _wins(act, manifest, "lift", Physics.stack([robots[robot] for robot in order]), trials, goals)
            kept[name] = {"farm_seed": farm_seed, "ranges": harder, "robot": order, "success": wins}
            kept[name] |= _against(wins, kept["real"]["success"], order)
            out.write_text(json.dumps(kept) + "\n")
        print(name, {key: kept[name][key] for key in ("rate", "difference", "difference_interval_95")}, flush=True)
    return kept


def drawn_robot(farm_seed: int, robot: str, harder: dict[str, tuple[float, float]]):
    """A robot's physics with other bounds for some ranges: the same random numbers put it at the same place within them."""
    from robot_farm.hidden_physics import HiddenPhysics, farm_secret
    from sim_backend.effects.ranges import load_ranges

    table = load_ranges("real")
    bounds = {row.key: (row.low, row.high) for row in table.rows} | harder
    rows = tuple(replace(row, low=bounds[row.key][0], high=bounds[row.key][1]) for row in table.rows)
    return replace(table, rows=rows).draw(HiddenPhysics(farm_secret(Path(), farm_seed), robot, "real").generator("physics"), 1)


def _against(wins: list[bool], before: list[bool], robots: list[str]) -> dict:
    """A rate and its paired difference to the one before, resampled over goals and robots."""
    difference = np.array(wins, dtype=float) - np.array(before, dtype=float)
    interval = difference_interval(difference[None], [np.array(robots)], np.random.default_rng(1))
    return {
        "rate": float(np.mean(wins)),
        "difference": float(difference.mean()),
        "difference_interval_95": list(interval),
    }


def _wins(act, manifest, task: str, physics, trials: int, goals: list[int] | None = None) -> list[bool]:
    """Success of each trial; seeds of the noise are always the same, and those of the goals too if none are given."""
    from sim_backend.evaluation import evaluate
    from sim_backend.tasks import TASKS as ALL_TASKS

    seeds = [JOB_SEED * 100_000 + index for index in range(trials)]
    noise = np.array(seeds, dtype=float)
    return evaluate(act, manifest, ALL_TASKS[task], goals or seeds, physics=physics, noise_seeds=noise).success.tolist()


def expert(weights: Path, task: str):
    """A published expert as an act, and its manifest."""
    from api_schemas.policy import LAYOUTS
    from api_schemas.policy_graph import session as session_of

    manifest = LAYOUTS[f"rrc2022-{task}"]
    with tempfile.TemporaryDirectory() as folder:
        wanted, graph = Path(folder) / "manifest.json", Path(folder) / "graph.onnx"
        wanted.write_text(manifest.model_dump_json())
        files = [str(weights.absolute()), str(wanted), str(graph)]
        command = [sys.executable, "-m", "services.policies.conversion", *files, "none"]
        subprocess.run(command, check=True, capture_output=True, cwd=folder)
        session = session_of(graph.read_bytes())
    name = session.get_inputs()[0].name
    return lambda observation: np.concatenate(
        [np.asarray(session.run(None, {name: row[None]})[0]) for row in observation]
    ), manifest


def main() -> int:
    """Run, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["farms", "groups", "band"])
    parser.add_argument("--experts", type=Path, required=True, help="folder of push_expert and lift_expert.safetensors")
    parser.add_argument("--out", type=Path, required=True, help="results, also of runs before")
    parser.add_argument("--farm-seeds", type=int, nargs="+", help="7001 7002 7003; 7001 for groups, 7003 for band")
    parser.add_argument("--trials", type=int, default=200)
    options = parser.parse_args()
    kept = json.loads(options.out.read_text()) if options.out.exists() else {}
    farm_seeds = options.farm_seeds or FARM_SEEDS[options.what]
    if options.what != "farms":
        measure = {"groups": group_rates, "band": band_rates}[options.what]
        measure(options.experts, farm_seeds[0], options.trials, kept, options.out)
        return 0
    farms = {"nominal": ["--physics", "nominal"]}
    farms |= {str(seed): ["--physics", "real", "--farm-seed", str(seed)] for seed in farm_seeds}
    for name, physics in farms.items():
        if name not in kept:
            kept[name] = farm_successes(options.experts, physics, options.trials)
            options.out.write_text(json.dumps(kept) + "\n")
    kept["summary"] = compared(kept["nominal"], [kept[str(seed)] for seed in farm_seeds])
    options.out.write_text(json.dumps(kept) + "\n")
    print(json.dumps(kept["summary"], indent=2))
    return 0


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    sys.exit(main())
