"""Trackers on images against the truth: on renders of robots that no training saw, and on photographs of a real TriFinger.

``python -m tests.benchmarks.image_trackers renders --rows ROWS.jsonl [--robots 200] [--scenes 10] [--reference-every 5]`` judges
frame by frame, without memory, and goes on where a file of rows ends; ``tables --rows ROWS.jsonl --out FILE.json`` sums up;
``cost --out FILE.json`` measures our tracker on one core.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sim_backend.driver.detection import detect, values_of
from sim_backend.effects.ranges import load_ranges
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE
from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.cameras import Cameras
from sim_backend.vision.image_tracker import SURE, ImageTracker, SeenPose
from sim_backend.vision.reference_tracker import track_by_colours
from sim_backend.vision.rotations import angle_between_rad, matrix_of_quat
from sim_backend.vision.scenes import Scene, drawn_scene
from sim_backend.vision.shown import hidden_share, shown_share

PRESET, FIRST_ROBOT = "real-images", 500_000
"""Robots are drawn from these seeds on; training and the choice of every threshold end far below."""
HIDDEN_BOUNDS = (0.0, 0.1, 0.3, 0.5, 0.7, 1.01)


def judged_robot(seed: int, scenes: int, reference_every: int) -> list[dict[str, Any]]:
    """Rows of one robot's scenes: what each tracker made of a frame."""
    rng = np.random.default_rng(seed)
    physics = load_ranges(PRESET).draw(rng, 1)
    values, tracker = values_of(physics, CUBE.size_m), ImageTracker(nominal_calibrations())
    half_m, rows = c.CUBE_WIDTH_M / 2 * float(physics.value("cube_size.factor")[0]), []
    with Cameras(physics) as cameras:
        for number in range(scenes):
            scene = drawn_scene(rng)
            state = scene.joint_position_rad, scene.position_world_m, scene.quat_wxyz
            images, faces = cameras.take(*state, seed=seed, frame=number), cameras.labels(*state)
            shown = [shown_share(face, each, scene, half_m) for face, each in zip(faces, cameras.true_calibrations, strict=True)]
            row: dict[str, Any] = {"robot": seed, "scene": number, "shown": [round(share, 4) for share, _ in shown]}
            row["hidden"] = round(hidden_share(shown), 4)
            row["ours"] = _timed(lambda: _alone(tracker, images), scene)  # noqa: B023
            if number % reference_every == 0:
                row["reference"] = _timed(lambda: track_by_colours(images, nominal_calibrations(), seed=number), scene)  # noqa: B023
            noise = np.array([seed]), np.array([number])
            _, confidence, position, quat, _, _ = detect(values, *noise, *(each[None] for each in state))
            row["formula"] = errors(position[0], matrix_of_quat(quat[0]), float(confidence[0]), scene)
            rows.append(row)
    return rows


def _alone(tracker: ImageTracker, images: np.ndarray) -> SeenPose:
    tracker.forget()
    return tracker.track(images)


def _timed(track: Callable[[], SeenPose], scene: Scene) -> dict[str, float]:
    began = time.process_time()
    found = track()
    cpu_s = time.process_time() - began
    row = errors(found.position_world_m, found.rotation, found.confidence, scene)
    deviation_mm = 1000 * np.sqrt(np.trace(found.covariance[:3, :3]))
    return row | {"cpu_s": round(cpu_s, 4)} | ({"expected_mm": round(deviation_mm, 2)} if np.isfinite(deviation_mm) else {})


def errors(position_m: np.ndarray, rotation: np.ndarray, confidence: float, scene: Scene) -> dict[str, float]:
    """How far a pose is from a scene's, in mm and degrees, and its confidence."""
    apart_mm = 1000 * float(np.linalg.norm(position_m - scene.position_world_m))
    apart_deg = float(np.rad2deg(angle_between_rad(rotation, matrix_of_quat(scene.quat_wxyz))))
    return {"mm": round(apart_mm, 3), "deg": round(apart_deg, 3), "confidence": round(confidence, 4)}


def table(rows: Sequence[dict[str, Any]], name: str) -> dict[str, Any]:
    """Medians and 95th percentiles of one tracker by the share of the cube that is hidden, of frames that count as seen."""
    rows = [row for row in rows if name in row]
    told: dict[str, Any] = {"all": _summary(rows, name)}
    for low, high in pairwise(HIDDEN_BOUNDS):
        part = [row for row in rows if low <= row["hidden"] < high]
        told[f"hidden {low:.0%} to {min(high, 1.0):.0%}"] = _summary(part, name)
    in_view = [row for row in rows if max(row["shown"]) >= 0.4]
    told["40 % of the cube shows in some view"] = _summary(in_view, name)
    if any("cpu_s" in row[name] for row in rows):
        told["cpu_s"] = round(float(np.median([row[name]["cpu_s"] for row in rows])), 4)
    return told


def _summary(rows: Sequence[dict[str, Any]], name: str) -> dict[str, Any]:
    seen = [row[name] for row in rows if row[name]["confidence"] >= SURE]
    told: dict[str, Any] = {"frames": len(rows), "not_seen": round(1 - len(seen) / max(len(rows), 1), 4)}
    for unit in ("mm", "deg"):
        for what, some in (("", seen), ("_of_all", [row[name] for row in rows])):
            if some:
                middle, high = np.percentile([each[unit] for each in some], [50, 95])
                told |= {f"median_{unit}{what}": round(float(middle), 2), f"p95_{unit}{what}": round(float(high), 2)}
    if seen:
        told["wrong"] = round(float(np.mean([each["mm"] > 15 or each["deg"] > 20 for each in seen])), 4)
    return told


def _renders(options: argparse.Namespace) -> None:
    done = {json.loads(line)["robot"] for line in options.rows.read_text().splitlines()} if options.rows.exists() else set()
    for seed in range(options.first, options.first + options.robots):
        if seed not in done:
            rows = judged_robot(seed, options.scenes, options.reference_every)
            with options.rows.open("a") as file:
                file.writelines(json.dumps(row) + "\n" for row in rows)


def _tables(options: argparse.Namespace) -> dict[str, Any]:
    rows = [json.loads(line) for line in options.rows.read_text().splitlines()]
    return {
        "what": "trackers on renders of robots that no training saw, each frame alone",
        "preset": PRESET,
        "robots": [min(row["robot"] for row in rows), max(row["robot"] for row in rows)],
        "frames": len(rows),
        "sure_from_confidence": SURE,
        **{name: table(rows, name) for name in ("ours", "reference", "formula")},
    }


def _cost(options: argparse.Namespace) -> dict[str, Any]:
    """Our tracker alone on one core, images ready: triples a second by CPU and by clock."""
    os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[0]})
    rng, tracker = np.random.default_rng(1), ImageTracker(nominal_calibrations())
    with Cameras() as cameras:
        taken = []
        for _ in range(options.scenes):
            scene = drawn_scene(rng)
            taken.append(cameras.take(scene.joint_position_rad, scene.position_world_m, scene.quat_wxyz))
    _alone(tracker, taken[0])
    began_cpu, began = time.process_time(), time.perf_counter()
    for images in taken:
        _alone(tracker, images)
    cpu_s, clock_s = time.process_time() - began_cpu, time.perf_counter() - began
    return {"triples": len(taken), "triples_per_cpu_s": len(taken) / cpu_s, "triples_per_s": len(taken) / clock_s}


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Judge the trackers on images.")
    parser.add_argument("what", choices=("renders", "tables", "cost"))
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--first", type=int, default=FIRST_ROBOT)
    parser.add_argument("--robots", type=int, default=200)
    parser.add_argument("--scenes", type=int, default=10)
    parser.add_argument("--reference-every", type=int, default=5)
    options = parser.parse_args(arguments)
    if options.what == "renders":
        _renders(options)
        return 0
    told = _tables(options) if options.what == "tables" else _cost(options)
    told["command"] = "python -m tests.benchmarks.image_trackers " + " ".join(sys.argv[1:] if arguments is None else arguments)
    told["at"] = datetime.now(UTC).isoformat(timespec="seconds")
    text = json.dumps(told, indent=1)
    if options.out:
        options.out.write_text(text + "\n")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
