"""What the seam of workers costs: ``python tests/benchmarks/workers_cost.py --out FILE``.

Rollouts of the same slices, in turns within one run: directly (the work is called), in one process, on Ray with one actor
(where it is installed), in two processes; each has one thread a worker. Figures are ratios to the direct loop of the same round,
median and range: other work on the machine disturbs them, so that they are to be repeated on a quiet one.
"""

import argparse
import functools
import importlib.util
import json
import os
import time
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any

FLOORS = {"one process": 0.95, "one on Ray": 0.9, "two processes": 1.7}


def measured(robots: int, slices: int, steps: int, rounds: int, ray: bool) -> dict[str, Any]:
    """Samples per second of each way, and their ratios to the direct loop."""
    from sim_backend.training.recipe import Recipe
    from sim_backend.training.rollouts import Order, RolloutWorker, SharedColumns, layout_of_rollouts
    from sim_backend.workers.pool import open_workers

    ppo = {"robots": robots, "steps": steps, "slices": slices, "minibatch": robots * steps}
    settings = {"task": "push", "layout": "push", "physics": "nominal", "episode_s": 5.0, "samples": 10**9, "ppo": ppo}
    recipe = Recipe.model_validate(settings)
    layout, direct = layout_of_rollouts(recipe, robots), RolloutWorker(recipe, slices)
    weights = {name: values.numpy().copy() for name, values in direct._policy.state_dict().items()}
    shared = SharedColumns(layout)
    make, alone = (
        functools.partial(RolloutWorker, recipe, slices, 1, (shared,)),
        functools.partial(RolloutWorker, recipe, slices, 1),
    )
    with ExitStack() as stack:
        ways: dict[str, Any] = {
            "one process": stack.enter_context(open_workers(make, 1)),
            "two processes": stack.enter_context(open_workers(make, 2)),
        }
        if ray:
            ways["one on Ray"] = stack.enter_context(open_workers(alone, 1, "local"))
        states: dict[str, list] = {name: [None] * slices for name in ("direct", *ways)}
        rates: list[dict[str, float]] = []
        for number in range(rounds + 1):
            found = {}
            for name in ("direct", *ways):
                orders = [Order(part, number, state) for part, state in enumerate(states[name])]
                begun_s = time.perf_counter()
                rollouts = (
                    [direct(order, weights) for order in orders] if name == "direct" else list(ways[name].map(orders, weights))
                )
                found[name] = robots * steps / (time.perf_counter() - begun_s)
                states[name] = [rollout.state for rollout in rollouts]
            rates.append(found)
        rates = rates[1:]  # the first round begins all trials
        moved = ways["one process"].moved_bytes / (robots * steps * (rounds + 1))
    ratios = {name: [each[name] / each["direct"] for each in rates] for name in ways}
    if "two processes" in ratios:
        ratios["two processes"] = [each["two processes"] / each["one process"] for each in rates]
    return {
        "samples_per_s": {name: median(each[name] for each in rates) for name in ("direct", *ways)},
        "ratios": {
            name: {"median": median(values), "least": min(values), "greatest": max(values), "floor": FLOORS[name]}
            for name, values in ratios.items()
        },
        "piped_bytes_per_sample": moved,
        "shared_bytes_per_sample": shared.nbytes / (robots * steps),
    }


def main() -> None:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="What the seam of workers costs.")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--robots", type=int, default=1024)
    parser.add_argument("--slices", type=int, default=8)
    parser.add_argument("--steps", type=int, default=16)
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--without-ray", action="store_true")
    options = parser.parse_args()
    ray = not options.without_ray and importlib.util.find_spec("ray") is not None
    sizes = {"robots": options.robots, "slices": options.slices, "steps": options.steps, "rounds": options.rounds}
    found = {**sizes, "cores": os.cpu_count(), "load_before": os.getloadavg()[0]} | measured(
        options.robots, options.slices, options.steps, options.rounds, ray
    )
    text = json.dumps(found | {"load_after": os.getloadavg()[0]}, indent=2)
    print(text)
    if options.out:
        options.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
