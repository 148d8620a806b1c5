"""What the controller without weights achieves on the four levels of the 2020 challenge; goes on where it was stopped.

    python -m tests.benchmarks.grasp_controller --out docs/results/grasp.json [--trials 200] [--first-seed 40000000]

Each level is tried on nominal robots and on robots of ``real``, with physics at 1 kHz.
"""

import argparse
import json
from pathlib import Path

from sim_backend.grasping.controller import GraspPolicy
from sim_backend.tasks import TASKS
from sim_backend.training.trying import try_policy

LEVELS = tuple(f"move_cube_{level}" for level in (1, 2, 3, 4))
KINDS = ("nominal", "real")


def main() -> None:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Try the controller without weights.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=40_000_000)
    given = parser.parse_args()
    found: list[dict] = json.loads(given.out.read_text())["tried"] if given.out.exists() else []
    seeds = range(given.first_seed, given.first_seed + given.trials)
    for physics in KINDS:
        for level in LEVELS:
            if any((row["task"], row["physics"]) == (level, physics) for row in found):
                continue
            tried, _ = try_policy(GraspPolicy(), GraspPolicy.manifest, TASKS[level], seeds, physics, threads=1)
            found.append({"task": level} | tried.document())
            given.out.write_text(json.dumps({"policy": "builtin:grasp", "tried": found}, indent=2) + "\n")
            print(f"{level}, {physics} robots: {tried.successes} of {tried.trials}", flush=True)


if __name__ == "__main__":
    main()
