"""How the published experts fare with a tracker on images, beside the formula that was fitted to it: same robots, same goals.

    python -m tests.benchmarks.seeing_experts --experts FOLDER --rows ROWS.jsonl --out FILE [--goals 200] [--processes 1]

Robots are drawn as ``real-images`` and, from the same random numbers, as ``real-2``: they differ only in how the object is found.
A trial is that of the farm, in its period, effects and scores; push and lift, formula and images take turns, so that whatever was
tried is balanced. A row is written for each trial, and kept rows are not tried again; the summary is of the pairs that are whole.
With ``--budget-s`` no trial begins later than that.
"""

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.driver.tracker import Tracker
from sim_backend.effects.ranges import load_ranges
from sim_backend.evaluation import evaluate
from sim_backend.tasks import TASKS
from sim_backend.vision.cameras import Cameras
from sim_backend.vision.image_detector import ImageDetector
from tests.benchmarks.published_experts import JOB_SEED, difference_interval, expert

EXPERTS = ("push", "lift")
PRESETS = {"pose": "real-2", "images": "real-images"}
ROBOTS, ROBOTS_SEED = 8, 2600
Trial = tuple[str, int, str]
"""Task, number of the goal, tracker."""


def trials(goals: int) -> Iterator[Trial]:
    """All, in the order in which they are tried."""
    for goal in range(goals):
        for task in EXPERTS:
            for tracker in PRESETS:
                yield task, goal, tracker


def tried(experts: Path, trial: Trial) -> dict[str, Any]:
    """One trial's row."""
    task, goal, tracker = trial
    robot, seed = goal % ROBOTS, JOB_SEED * 100_000 + goal
    physics = load_ranges(PRESETS[tracker]).draw(np.random.default_rng([ROBOTS_SEED, robot]), 1)
    act, manifest = expert(experts / f"{task}_expert.safetensors", task)
    began_s, noise = time.monotonic(), np.array([seed], dtype=float)
    cameras = ImageDetector(Cameras(physics)) if tracker == "images" else None
    try:
        found = evaluate(
            act,
            manifest,
            TASKS[task],
            [seed],
            physics=physics,
            noise_seeds=noise,
            threads=1,
            tracker=Tracker(physics=physics, detector=cameras) if cameras else None,
        )
    finally:
        if cameras is not None:
            cameras.close()
    return {
        "task": task,
        "goal": goal,
        "tracker": tracker,
        "robot": robot,
        "success": bool(found.success[0]),
        "error_mm": round(1000 * float(found.position_error_m[0]), 1),
        "wall_s": round(time.monotonic() - began_s, 2),
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Rates and paired differences, by task, with 95 % intervals over goals and robots."""
    by_trial, told = {(row["task"], row["goal"], row["tracker"]): row for row in rows}, {}
    for task in EXPERTS:
        goals = [
            goal for of, goal, tracker in by_trial if of == task and tracker == "images" and (task, goal, "pose") in by_trial
        ]
        if len(goals) < 2:
            continue
        pose, images = (np.array([by_trial[task, goal, name]["success"] for goal in goals], float) for name in PRESETS)
        robots = np.array([by_trial[task, goal, "pose"]["robot"] for goal in goals])
        interval = difference_interval((images - pose)[None], [robots], np.random.default_rng(1))
        told[task] = {"goals": len(goals), "pose": pose.mean(), "images": images.mean(), "difference": (images - pose).mean()}
        told[task] |= {"difference_interval_95": list(interval)}
        told[task]["wall_s"] = {n: float(np.median([by_trial[task, goal, n]["wall_s"] for goal in goals])) for n in PRESETS}
    return told


def main(arguments: list[str] | None = None) -> int:
    """Try, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experts", type=Path, required=True, help="folder of push_expert and lift_expert.safetensors")
    parser.add_argument("--rows", type=Path, required=True, help="a row for each trial, also of runs before")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--goals", type=int, default=200)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--budget-s", type=float, default=float("inf"), help="after which none begins")
    given = parser.parse_args(arguments)
    began_s = time.monotonic()
    rows = [json.loads(line) for line in given.rows.read_text().splitlines()] if given.rows.exists() else []
    kept = {(row["task"], row["goal"], row["tracker"]) for row in rows}
    left = [trial for trial in trials(given.goals) if trial not in kept]
    with multiprocessing.get_context("spawn").Pool(given.processes) as pool, given.rows.open("a") as out:
        for first in range(0, len(left), given.processes):
            if time.monotonic() - began_s > given.budget_s:
                break
            for row in pool.starmap(tried, [(given.experts, trial) for trial in left[first : first + given.processes]], 1):
                rows.append(row)
                out.write(json.dumps(row) + "\n")
                out.flush()
                print(row, flush=True)
    told = {"at": datetime.now(UTC).isoformat(timespec="seconds"), "cores": os.cpu_count(), "goals_wanted": given.goals}
    given.out.write_text(json.dumps(told | {"presets": PRESETS, "tasks": summary(rows)}, indent=1) + "\n")
    print(json.dumps(summary(rows), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
