"""What the controllers without weights achieve, on the 2020 challenge's levels and where the cube is to be turned.

    python -m tests.benchmarks.grasp_controller --out results/grasp.json [--trials 200] [--first-seed 40000000]
    python -m tests.benchmarks.grasp_controller --out results/grasp.json --through-farm 7001

Each task is tried on nominal robots and on robots of ``real``, with physics at 1 kHz. With ``--through-farm`` each level is
instead one job of 40 trials on a farm of ``real`` robots of that seed, through its API. Goes on where it was stopped.
"""

import argparse
import json
from itertools import product
from pathlib import Path

from api_schemas.builtin_policies import BUILTIN, PREFIX
from sim_backend.grasping.controller import GraspPolicy
from sim_backend.tasks import TASKS
from sim_backend.training.trying import try_policy
from tests.benchmarks.shipped_policy import through_farm

LEVELS = tuple(f"move_cube_{level}" for level in (1, 2, 3, 4))
TRIED_ON = {"grasp": LEVELS, "grasp-turn": ("floor_pose", "move_cube_4")}
TASKS_TRIED = tuple(dict.fromkeys(task for tasks in TRIED_ON.values() for task in tasks))
KINDS = ("nominal", "real")
FARM_TRIALS, FARM_ROBOTS = 40, 4


def main() -> None:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Try the controllers without weights.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--tasks", nargs="+", choices=TASKS_TRIED, default=list(TASKS_TRIED))
    parser.add_argument("--first-seed", type=int, default=40_000_000)
    parser.add_argument("--through-farm", metavar="SEED")
    given = parser.parse_args()
    kept = json.loads(given.out.read_text()) if given.out.exists() else {"tried": []}
    if given.through_farm is not None:
        _through_farm(given.out, kept, given.through_farm, given.tasks)
    else:
        _in_simulation(given, kept)


def _in_simulation(given: argparse.Namespace, kept: dict) -> None:
    found: list[dict] = kept["tried"]
    seeds = range(given.first_seed, given.first_seed + given.trials)
    for name, physics in product(TRIED_ON, KINDS):
        for task in [task for task in TRIED_ON[name] if task in given.tasks]:
            key = {"policy": PREFIX + name, "task": task}
            if any(row.items() >= (key | {"physics": physics}).items() for row in found):
                continue
            tried, _ = try_policy(GraspPolicy(BUILTIN[name]), BUILTIN[name], TASKS[task], seeds, physics, threads=1)
            found.append(key | tried.document())
            given.out.write_text(json.dumps(kept, indent=2) + "\n")
            print(f"{PREFIX}{name}, {task}, {physics} robots: {tried.successes} of {tried.trials}", flush=True)


def _through_farm(out: Path, kept: dict, farm_seed: str, tasks: list[str]) -> None:
    farms = kept.setdefault("farms", {}).setdefault(farm_seed, {})
    for task in [level for level in LEVELS if level in tasks]:
        if task not in farms:
            farms[task] = through_farm(f"{PREFIX}grasp", task, farm_seed, FARM_TRIALS, FARM_ROBOTS)
            out.write_text(json.dumps(kept, indent=2) + "\n")
        success = farms[task]["success"]
        print(f"{task}, farm {farm_seed}: {sum(success)} of {len(success)}", flush=True)


if __name__ == "__main__":
    main()
