"""How the published experts fare with a tracker on images, beside the formula that was fitted to it: same robots, same goals.

    python -m tests.benchmarks.seeing_experts --experts FOLDER --rows ROWS.jsonl --out FILE [--goals 200] [--processes 1]

Robots are drawn as ``real-images`` and, from the same random numbers, as ``real-2``: they differ only in how the object is found.
A trial is that of the farm, in its period, effects and scores; push and lift, formula and images take turns, so that whatever was
tried is balanced. A row is written as a trial ends, and kept rows are not tried again, wherever they were made: files of rows may
be put one after the other. The summary is of the pairs that are whole. With ``--budget-s`` no trial begins later than that, with
0 the rows are only summed up; SIGTERM ends it between two rows. Each process needs one core and about 0.7 GB.
"""

import argparse
import functools
import json
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.driver.tracker import Tracker
from sim_backend.effects.ranges import load_ranges
from sim_backend.evaluation import evaluate
from sim_backend.tasks import TASKS
from sim_backend.trifinger import constants as c
from sim_backend.vision.cameras import Cameras
from sim_backend.vision.image_detector import ImageDetector
from sim_backend.vision.pictures import opencv
from sim_backend.vision.seen_pixels import NETWORK_FILE
from tests.benchmarks.published_experts import JOB_SEED, difference_interval, expert

EXPERTS = ("push", "lift")
PRESETS = {"pose": "real-2", "images": "real-images"}
ROBOTS, ROBOTS_SEED = 8, 2600
FEWEST = 3 * ROBOTS
"""Goals from which on there is an interval: of fewer, draws of robots and of goals may have nothing in common."""
Trial = tuple[str, int, str]
"""Task, number of the goal, tracker."""


def trials(goals: int, tasks: Sequence[str] = EXPERTS) -> Iterator[Trial]:
    """All, in the order in which they are tried."""
    for goal in range(goals):
        for task in tasks:
            for tracker in PRESETS:
                yield task, goal, tracker


def tried(experts: Path, deadline_s: float, trial: Trial) -> dict[str, Any] | None:
    """One trial's row; None if the monotonic clock says that it begins too late."""
    if time.monotonic() > deadline_s:
        return None
    task, goal, tracker = trial
    robot, seed = goal % ROBOTS, JOB_SEED * 100_000 + goal
    physics = load_ranges(PRESETS[tracker]).draw(np.random.default_rng([ROBOTS_SEED, robot]), 1)
    act, manifest = known_expert(experts, task)
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
        painted = {"renderer": renderer()} if cameras is not None else {}
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
        **painted,
    }


def renderer() -> str:
    """What paints, as OpenGL says it: a GPU, or Mesa's llvmpipe on the processor."""
    from OpenGL import GL

    return bytes(GL.glGetString(GL.GL_RENDERER) or b"unknown").decode()


@functools.cache
def known_expert(experts: Path, task: str):
    """An expert, converted once a process."""
    return expert(experts / f"{task}_expert.safetensors", task)


def on_one_core() -> None:
    """Mesa and OpenCV paint in the process that asks, not in a thread for each core beside it; the pixels are the same."""
    os.environ["LP_NUM_THREADS"] = "0"
    opencv().setNumThreads(1)


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Rates and paired differences, by task, with 95 % intervals over goals and robots."""
    by_trial, told = {(row["task"], row["goal"], row["tracker"]): row for row in rows}, {}
    for task in EXPERTS:
        tried_by = [{goal for of, goal, by in by_trial if (of, by) == (task, tracker)} for tracker in PRESETS]
        goals = sorted(set.intersection(*tried_by))
        if not goals:
            continue
        pairs = {name: [by_trial[task, goal, name] for goal in goals] for name in PRESETS}
        pose, images = (np.array([row["success"] for row in pairs[name]], float) for name in PRESETS)
        robots = np.array([row["robot"] for row in pairs["pose"]])
        interval = difference_interval((images - pose)[None], [robots], np.random.default_rng(1)) if len(goals) >= FEWEST else ()
        wall_s = {name: float(np.median([row["wall_s"] for row in found])) for name, found in pairs.items()}
        simulated_s = TASKS[task].steps * c.PHYSICS_STEP_S
        told[task] = {
            "goals": len(goals),
            "pose": round(float(pose.mean()), 4),
            "images": round(float(images.mean()), 4),
            "only_pose": int((pose > images).sum()),
            "only_images": int((images > pose).sum()),
            "difference": round(float((images - pose).mean()), 4),
            "difference_interval_95": [round(edge, 4) for edge in interval] or None,
            "median_error_mm": {name: float(np.median([row["error_mm"] for row in found])) for name, found in pairs.items()},
            "wall_s": wall_s,
            "simulated_s_per_wall_s": {name: round(simulated_s / each, 3) for name, each in wall_s.items()},
        }
    return told


def kept_rows(path: Path) -> list[dict[str, Any]]:
    """The rows of a file, none if it is missing; a trial's first row counts."""
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    first: dict[Trial, dict[str, Any]] = {}
    for row in lines:
        first.setdefault((row["task"], row["goal"], row["tracker"]), row)
    return list(first.values())


def add_rows(given: argparse.Namespace, rows: list[dict[str, Any]]) -> None:
    """Try what is missing, and keep each row as it comes."""
    kept = {(row["task"], row["goal"], row["tracker"]) for row in rows}
    left = [trial for trial in trials(given.goals, given.tasks) if trial not in kept]
    try_one = functools.partial(tried, given.experts, time.monotonic() + given.budget_s)
    pool = multiprocessing.get_context("spawn").Pool(given.processes, on_one_core)
    with pool, given.rows.open("a") as out:
        for row in pool.imap_unordered(try_one, left):
            if row is not None:
                rows.append(row)
                out.write(json.dumps(row) + "\n")
                out.flush()
                print(row, flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Try, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experts", type=Path, required=True, help="folder of push_expert and lift_expert.safetensors")
    parser.add_argument("--rows", type=Path, required=True, help="a row for each trial, also of runs before")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--goals", type=int, default=200)
    parser.add_argument("--tasks", nargs="+", choices=EXPERTS, default=list(EXPERTS))
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--budget-s", type=float, default=float("inf"), help="after which no trial begins")
    given = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    rows = kept_rows(given.rows)
    try:
        if given.budget_s > 0:
            add_rows(given, rows)
    finally:
        told = {"at": datetime.now(UTC).isoformat(timespec="seconds"), "cores": os.cpu_count(), "goals_wanted": given.goals}
        told |= {"presets": PRESETS, "network_sha256": sha256(NETWORK_FILE.read_bytes()).hexdigest(), "tasks": summary(rows)}
        given.out.write_text(json.dumps(told, indent=1) + "\n")
        print(json.dumps(told["tasks"], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
