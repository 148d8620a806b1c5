"""Do policies fare the same on two forms of the scene? The same goals by two checkouts, and the paired difference.

    python tests/benchmarks/form_outcomes.py run --checkout FOLDER --experts FOLDER --to KEPT.jsonl [--goals 2000] [--policies …]
    python tests/benchmarks/form_outcomes.py compare --old OLD.jsonl --new NEW.jsonl --out results/form-outcomes.json

``run`` imports the simulation from the checkout named, so that one program runs on both; its batches are kept as they come, and
kept ones are not redone. Robots are nominal, physics at 1 kHz. ``compare`` pairs goal by goal.
"""

import argparse
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

FIRST_SEED = 70_000_000
BATCH = 100
RESAMPLES = 9999
BOUND = 0.03
"""A form is as the other if the 95 % interval of the paired difference lies within plus and minus this."""
POLICIES = {
    "push_expert": "push",
    "lift_expert": "lift",
    "push-adr": "push",
    "builtin:grasp": "move_cube_2",
}
"""Policies and their tasks; the two experts are those published for the real robot."""


def run(checkout: Path, experts: Path, kept: Path, goals: int, policies: list[str]) -> None:
    """Try the goals of each policy with the simulation of a checkout."""
    sys.path[:1] = [str(checkout.absolute())]
    done = {(row["policy"], row["first"]) for row in _rows(kept)}
    evaluate = importlib.import_module("sim_backend.evaluation").evaluate
    tasks = importlib.import_module("sim_backend.tasks").TASKS
    assert Path(sys.modules["sim_backend.evaluation"].__file__ or "").is_relative_to(checkout.absolute()), "another checkout"
    for name in policies:
        act = manifest = None
        for first in range(0, goals, BATCH):
            if (name, first) in done:
                continue
            if act is None:
                act, manifest = _policy(name, experts, checkout)
            started_s, count = time.process_time(), min(BATCH, goals - first)
            seeds = range(FIRST_SEED + first, FIRST_SEED + first + count)
            found = evaluate(act, manifest, tasks[POLICIES[name]], seeds, threads=1)
            row = {
                "policy": name,
                "first": first,
                "success": found.success.astype(int).tolist(),
                "position_error_mm": np.round(1000 * found.position_error_m, 3).tolist(),
                "cpu_s": round(time.process_time() - started_s, 1),
            }
            with kept.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(f"{name} from {first}: {np.mean(found.success):.2f}, {row['cpu_s']} s", flush=True)


def _policy(name: str, experts: Path, checkout: Path):
    """What acts, and its manifest."""
    if name.startswith("builtin:"):
        builtin = importlib.import_module("api_schemas.builtin_policies").BUILTIN[name.removeprefix("builtin:")]
        return importlib.import_module("sim_backend.grasping.controller").GraspPolicy(builtin), builtin
    schemas = importlib.import_module("api_schemas.policy")
    if name.endswith("_expert"):
        weights, manifest = experts / f"{name}.safetensors", schemas.LAYOUTS[f"rrc2022-{POLICIES[name]}"]
    else:
        weights = checkout / "sim_backend/training/reference_policies" / f"{name}.safetensors"
        manifest = schemas.PolicyManifest.model_validate_json(weights.with_suffix(".json").read_text())
    import onnxruntime

    with tempfile.TemporaryDirectory() as folder:
        wanted, graph = Path(folder) / "manifest.json", Path(folder) / "graph.onnx"
        wanted.write_text(manifest.model_dump_json())
        files = [str(weights.absolute()), str(wanted), str(graph)]
        command = [sys.executable, "-m", "services.policies.conversion", *files, "none"]
        environment = os.environ | {"PYTHONPATH": str(checkout.absolute())}
        subprocess.run(command, check=True, capture_output=True, cwd=folder, env=environment)
        settings = onnxruntime.SessionOptions()
        settings.intra_op_num_threads = settings.inter_op_num_threads = 1
        session = onnxruntime.InferenceSession(graph.read_bytes(), settings, providers=["CPUExecutionProvider"])
    given = session.get_inputs()[0].name
    return (lambda rows: np.concatenate([np.asarray(session.run(None, {given: row[None]})[0]) for row in rows])), manifest


def compare(old: Path, new: Path) -> dict:
    """The paired table: for each policy both rates, how many goals changed sides, and the 95 % interval of the difference."""
    table, rng = {}, np.random.default_rng(1)
    before, after = _by_policy(old), _by_policy(new)
    for name, task in POLICIES.items():
        goals = sorted(before.get(name, {}).keys() & after.get(name, {}).keys())
        if not goals:
            continue
        pairs = np.array([(before[name][goal], after[name][goal]) for goal in goals], dtype=float)
        difference = pairs[:, 1] - pairs[:, 0]
        drawn = rng.multinomial(len(goals), np.full(len(goals), 1 / len(goals)), size=RESAMPLES) @ difference / len(goals)
        low, high = np.quantile(drawn, [0.025, 0.975])
        table[name] = {
            "task": task,
            "goals": len(goals),
            "old": float(pairs[:, 0].mean()),
            "new": float(pairs[:, 1].mean()),
            "only_old": int((difference < 0).sum()),
            "only_new": int((difference > 0).sum()),
            "difference": float(difference.mean()),
            "difference_interval_95": [float(low), float(high)],
            "within_bound": bool(low >= -BOUND and high <= BOUND),
        }
    return table


def _rows(kept: Path) -> list[dict]:
    return [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []


def _by_policy(kept: Path) -> dict[str, dict[int, int]]:
    found: dict[str, dict[int, int]] = {}
    for row in _rows(kept):
        goals = found.setdefault(row["policy"], {})
        goals |= {row["first"] + index: success for index, success in enumerate(row["success"])}
    return found


def main() -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    running = commands.add_parser("run", help="try the goals with the simulation of a checkout")
    running.add_argument("--checkout", type=Path, required=True)
    running.add_argument("--experts", type=Path, default=Path("../shared/data/policies"))
    running.add_argument("--to", type=Path, required=True)
    running.add_argument("--goals", type=int, default=2000)
    running.add_argument("--policies", nargs="+", choices=POLICIES, default=list(POLICIES))
    comparing = commands.add_parser("compare", help="pair the goals of two runs")
    comparing.add_argument("--old", type=Path, required=True)
    comparing.add_argument("--new", type=Path, required=True)
    comparing.add_argument("--out", type=Path)
    options = parser.parse_args()
    if options.command == "run":
        run(options.checkout, options.experts, options.to, options.goals, options.policies)
        return 0
    table = compare(options.old, options.new)
    for name, row in table.items():
        low, high = (100 * end for end in row["difference_interval_95"])
        sides = f"{row['only_old']} only before, {row['only_new']} only after"
        rates = f"{row['old']:.3f} -> {row['new']:.3f}"
        print(f"{name:14} {row['goals']} goals: {rates}, {sides}; difference 95 % interval {low:+.2f} to {high:+.2f} points")
    if options.out:
        options.out.write_text(json.dumps(table, indent=2) + "\n")
    return 0 if table and all(row["within_bound"] for row in table.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
