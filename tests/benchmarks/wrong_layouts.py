"""Published experts in wrong orders, scales and widths, and what is noticed: ``python -m tests.benchmarks.wrong_layouts``.

The right layouts come first: of them nothing should be said. The seeds are others than those that the limits of
``sim_backend.trying`` were chosen with (25,000 on).
"""

import argparse
import json
import sys
from pathlib import Path

from api_schemas.policy import LAYOUTS, OutputScaling, PolicyManifest
from client_cli.packing.comparison import converted
from client_cli.terminal.errors import ClientError
from services.policies import dry_run
from services.policies.unfit import UnfitError
from sim_backend import trying
from sim_backend.tasks import TASKS
from tests.benchmarks.peer import EXPERTS

FIRST_SEED = 77_000
JOINTS, SPEEDS, CUBE, ACTION = "joint_position_rad", "joint_velocity_rad_s", "cube_keypoints_world_m", "previous_action"
PLACE, CORNERS = "goal_position_world_m", "goal_keypoints_world_m"
ORDERS = {
    "push": {
        "right": (JOINTS, SPEEDS, CUBE, PLACE, ACTION),
        "velocities first": (SPEEDS, JOINTS, CUBE, PLACE, ACTION),
        "action before the cube": (JOINTS, SPEEDS, ACTION, CUBE, PLACE),
        "goal before the cube": (JOINTS, SPEEDS, PLACE, CUBE, ACTION),
        "everything backwards": (ACTION, PLACE, CUBE, SPEEDS, JOINTS),
        "54 numbers of the whole observation": ("fingertip_force", JOINTS, SPEEDS, CUBE, ACTION),
    },
    "lift": {
        "right": (JOINTS, SPEEDS, CUBE, CORNERS, ACTION),
        "goal and cube changed": (JOINTS, SPEEDS, CORNERS, CUBE, ACTION),
        "velocities first": (SPEEDS, JOINTS, CUBE, CORNERS, ACTION),
    },
}


def said_of(task: str, weights: bytes, manifest: PolicyManifest) -> list[str]:
    """Everything that a user is told of a policy."""
    try:
        graph = converted(weights, ".safetensors", manifest)
        warnings = [f"the policy {each}" for each in dry_run.run(dry_run.load(graph), manifest)]  # pyrefly: ignore[bad-argument-type]
    except (ClientError, UnfitError) as error:
        return [str(error).splitlines()[0]]
    found = trying.run(graph, manifest, TASKS[task], FIRST_SEED)
    outside = trying.outside_range(graph, manifest, found.observations)
    return warnings + trying.warnings_of(found, outside, manifest, task)


def main(arguments: list[str] | None = None) -> int:
    """Try each, print, keep."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.wrong_layouts", description=__doc__)
    parser.add_argument("--experts", type=Path, default=EXPERTS, help="folder of push_expert and lift_expert.safetensors")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--most", type=int, help="cases of each expert")
    asked = parser.parse_args(arguments)
    if not asked.experts.is_dir():
        print(f"skipped: the published experts are not in {asked.experts}; give their folder by --experts")
        return 0
    rows = []
    for task, orders in ORDERS.items():
        weights, layout = (asked.experts / f"{task}_expert.safetensors").read_bytes(), LAYOUTS[f"rrc2022-{task}"]
        cases = {name: layout.model_copy(update={"observation": order}) for name, order in orders.items()}
        if task == "push":
            cases["a scale of 1 instead of 0.397"] = layout.model_copy(update={"output_scaling": OutputScaling(scale=1.0)})
            cases["97 numbers"] = LAYOUTS["rrc2022-push-flat"]
        for name, manifest in list(cases.items())[: asked.most]:
            rows.append({"task": task, "case": name, "said": said_of(task, weights, manifest)})
            asked.out.write_text(json.dumps({"first_seed": FIRST_SEED, "rows": rows}, indent=1) + "\n")
            print(json.dumps(rows[-1]), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
