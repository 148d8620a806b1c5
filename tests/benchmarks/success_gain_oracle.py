"""What an identified model could buy at most: lift success predicted by models that know a robot's hidden physics.

    python tests/benchmarks/success_gain_oracle.py --experts FOLDER --out FILE [--farm-seed 7101] [--robot robot-0] [--trials 200]

"Measured" are trials on the robot's whole hidden physics with noise of their own. They are predicted by the nominal model, by an
oracle that has the true values of all effects that logs of joints can show (groups actuation, body and sensing) and by one that
has everything. A second measurement with other noise says how far two measurements of the same robot differ. Outcomes are
written as they come, and kept ones are not redone.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent.parent
JOB_SEED = 31
MEASURED_SEED, AGAIN_SEED = 500_000_000, 900_000_000
RNG_SEED = 1


def outcomes(options: argparse.Namespace, kept: dict) -> dict:
    """Success of each trial under each model."""
    from robot_farm.hidden_physics import HiddenPhysics, farm_secret
    from sim_backend.effects.catalogue import CATALOGUE
    from sim_backend.effects.effect import Group
    from sim_backend.effects.physics import Physics
    from sim_backend.evaluation import evaluate
    from sim_backend.reality_gap.success.policy_file import load_policy
    from sim_backend.tasks import TASKS

    true = HiddenPhysics(farm_secret(Path(), options.farm_seed), options.robot, "real").physics
    beyond = [e.name for e in CATALOGUE.values() if e.group not in (Group.ACTUATION, Group.BODY, Group.SENSING)]
    act, manifest = load_policy(options.experts / "lift_expert.safetensors", "rrc2022-lift")
    seeds = [JOB_SEED * 100_000 + index for index in range(options.trials)]
    for name, physics, first in (
        ("nominal", Physics.nominal(), 1),
        ("measured", true, MEASURED_SEED),
        ("oracle_joint", true.without(beyond), 1),
        ("oracle_all", true, 1),
        ("measured_again", true, AGAIN_SEED),
    ):
        if name not in kept:
            robots, noise = Physics.stack([physics] * len(seeds)), np.asarray(seeds, dtype=float) + first
            found = evaluate(act, manifest, TASKS["lift"], seeds, physics=robots, noise_seeds=noise, threads=options.threads)
            kept[name] = found.success.tolist()
            options.out.write_text(json.dumps(kept) + "\n")
            print(f"{name}: {found.success.mean():.3f}", flush=True)
    return kept | {"farm_seed": options.farm_seed, "robot": options.robot, "oracle_joint_without": sorted(beyond)}


def summary(kept: dict) -> dict:
    """The gain of each oracle, and what two measurements of the same robot differ by."""
    from sim_backend.reality_gap.success.gain import success_gain

    return {
        name: success_gain(kept["nominal"], kept[name], kept["measured"], np.random.default_rng(RNG_SEED)).document()
        for name in ("oracle_joint", "oracle_all", "measured_again")
        if name in kept
    }


def main() -> int:
    """Run, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experts", type=Path, required=True, help="folder of lift_expert.safetensors")
    parser.add_argument("--out", type=Path, required=True, help="outcomes, also of runs before")
    parser.add_argument("--farm-seed", type=int, default=7101)
    parser.add_argument("--robot", default="robot-0")
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    kept = outcomes(options, json.loads(options.out.read_text()) if options.out.exists() else {})
    kept["summary"] = summary(kept)
    options.out.write_text(json.dumps(kept) + "\n")
    for name, gain in kept["summary"].items():
        print(f"{name}: {gain['summary']}")
    return 0


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    sys.exit(main())
