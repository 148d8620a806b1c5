"""How the tracker on images does: on renders of robots that no training saw, and on photographs of a real robot.

``python -m tests.benchmarks.tracker_on_images renders --out FILE [--robots N --views N --seed N]`` and
``... photographs --photos DIR --out FILE``; DIR is ``shared/data/trifinger_photos``. A file that is there is never overwritten:
the first try on the photographs stands, dated.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from sim_backend.effects.ranges import load_ranges
from sim_backend.trifinger import constants as c
from sim_backend.vision.calibration import Calibration, calibration_of, nominal_calibrations
from sim_backend.vision.cameras import Cameras
from sim_backend.vision.colours import FACES, segmented
from sim_backend.vision.pose_search import cost_px
from sim_backend.vision.tracking import sampled, track
from sim_backend.vision.train_colours import PRESET, random_state
from sim_backend.vision.views import rotation_of

LETTERS = {"r": "+x", "m": "-x", "g": "+y", "y": "-y", "b": "+z", "c": "-z"}
COLOURS = {"red": "+x", "magenta": "-x", "green": "+y", "yellow": "-y", "blue": "+z", "cyan": "-z"}
SEED_OFFSET = 1_000_000
"""Robots of a measurement are drawn from other seeds than those of any training."""
UP = "-x"
"""Face that looks up in the photographs of three cameras: magenta, as the masks of camera180 show."""


def apart(
    position: np.ndarray, rotation: np.ndarray, true_position: np.ndarray, true_rotation: np.ndarray
) -> tuple[float, float]:
    """Distance, mm, and angle, degrees, between two poses."""
    turn = Rotation.from_matrix(rotation.T @ true_rotation).magnitude()
    return 1000 * float(np.linalg.norm(position - true_position)), float(np.degrees(turn))


def on_renders(robots: int, views: int, seed: int) -> dict[str, Any]:
    """Errors over renders of randomised robots with fingers anywhere; the tracker has the nominal calibration."""
    rng, rows = np.random.default_rng(SEED_OFFSET + seed), []
    for _ in range(robots):
        with Cameras(load_ranges(PRESET).draw(rng, 1)) as cameras:
            for view in range(views):
                state = random_state(rng)
                images, labels = cameras.take(*state, frame=view), cameras.labels(*state)
                bare = cameras.labels(np.tile([1.0, 1.57, -2.7], 3), *state[1:])
                begun = time.process_time()
                found = track(images, nominal_calibrations(), seed=view)
                took_s = time.process_time() - begun
                error = apart(found.position_world_m, found.rotation, state[1], rotation_of(state[2]))
                seen = float((labels > 0).sum() / max(int((bare > 0).sum()), 1))
                rows.append((*error, found.confidence, seen, took_s))
    return {"robots": robots, "views": views, "seed": seed, "preset": PRESET, **summary(np.array(rows))}


def summary(rows: np.ndarray) -> dict[str, Any]:
    """Medians and 95th percentiles of position (mm) and angle (degrees), all, by confidence and by the share that is seen."""

    def of(which: np.ndarray) -> dict[str, float]:
        part = rows[which]
        if not len(part):
            return {"frames": 0}
        middle, high = np.percentile(part[:, :2], [50, 95], axis=0)
        return {
            "frames": len(part),
            "median_mm": round(float(middle[0]), 2),
            "median_deg": round(float(middle[1]), 2),
            "p95_mm": round(float(high[0]), 1),
            "p95_deg": round(float(high[1]), 1),
        }

    sure, seen = rows[:, 2] >= 0.75, rows[:, 3]
    return {
        "all": of(np.ones(len(rows), bool)),
        "confidence_at_least_0.75": of(sure),
        "seen_at_least_0.8": of(seen >= 0.8),
        "seen_0.4_to_0.8": of((seen >= 0.4) & (seen < 0.8)),
        "seen_below_0.4": of(seen < 0.4),
        "cpu_s_each": round(float(rows[:, 4].mean()), 3),
    }


def on_photographs(folder: Path) -> dict[str, Any]:
    """Pose against that of the hand-drawn masks with the cube on the floor, and overlap of masks."""
    place = folder / "pose_detection" / "cube_v2"
    names = ("60", "180", "300")
    calibration = [
        calibration_of(yaml.safe_load((place / f"camera_calib_{name}.yml").read_text())).resized(c.CAMERA_IMAGE_PX)
        for name in names
    ]
    images = [halved(read(place / f"camera{name}.png")) for name in names]
    hand = [hand_mask({face: place / f"{letter}{name}.png" for letter, face in LETTERS.items()}) for name in names]
    reference, spread = reference_pose(hand, calibration)
    tries = []
    for seed in range(5):
        found = track(images, calibration, seed=seed)
        mm, degrees = apart(found.position_world_m, found.rotation, *reference)
        height = 1000 * float(found.position_world_m[2] - reference[0][2])
        tries.append({"seed": seed, "mm": mm, "deg": degrees, "height_mm": height, "confidence": found.confidence})
    return {
        "reference": {
            "position_m": reference[0].tolist(),
            "rotation": reference[1].tolist(),
            "spread_of_pairs_of_cameras": spread,
        },
        "tries": tries,
        "overlap_pose_v2": {
            name: overlaps(segmented(image), mask) for name, image, mask in zip(names, images, hand, strict=True)
        },
        "overlap_segmentation": {
            f"{version}/{number}": overlaps(*single(folder / "segmentation" / version, number))
            for version in ("cube_v2", "cube_v3")
            for number in ("01", "02")
        },
    }


def read(path: Path) -> np.ndarray:
    """An image, red first."""
    return cv2.imread(str(path), cv2.IMREAD_COLOR)[..., ::-1]


def halved(image: np.ndarray) -> np.ndarray:
    """Each pixel is the mean of four."""
    return cv2.resize(np.ascontiguousarray(image), (c.CAMERA_IMAGE_PX,) * 2, interpolation=cv2.INTER_AREA)


def hand_mask(files: dict[str, Path]) -> np.ndarray:
    """Classes of pixels of 270 by hand-drawn masks of 540, those that are there."""
    out = np.zeros((c.CAMERA_IMAGE_PX,) * 2, np.uint8)
    for face, file in files.items():
        if file.is_file():
            mask = (cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) > 0).astype(np.float32)
            out[halved(mask) > 0.5] = FACES.index(face) + 1
    return out


def single(folder: Path, number: str) -> tuple[np.ndarray, np.ndarray]:
    """Classes of a single photograph as found and as drawn by hand."""
    drawn = hand_mask({face: folder / f"{number}_mask_{colour}.png" for colour, face in COLOURS.items()})
    return segmented(halved(read(folder / f"{number}_image.png"))), drawn


def overlaps(found: np.ndarray, drawn: np.ndarray) -> dict[str, float]:
    """Pixels in both over pixels in either, by colour, for those that either has."""
    names = {face: colour for colour, face in COLOURS.items()}
    shares = {}
    for number, face in enumerate(FACES, 1):
        both, either = ((found == number) & (drawn == number)).sum(), ((found == number) | (drawn == number)).sum()
        if either:
            shares[names[face]] = round(float(both / either), 3)
    return shares


def reference_pose(
    masks: Sequence[np.ndarray], calibration: Sequence[Calibration]
) -> tuple[tuple[np.ndarray, np.ndarray], dict[str, Any]]:
    """The pose on the floor that fits the hand-drawn masks best, and what pairs of cameras make of it."""
    whole = fitted(masks, calibration)
    pairs = [fitted([masks[k] for k in kept], [calibration[k] for k in kept]) for kept in ((0, 1), (0, 2), (1, 2))]
    differences = [apart(*pair, *whole) for pair in pairs]
    return whole, {"mm": [round(mm, 2) for mm, _ in differences], "deg": [round(degrees, 2) for _, degrees in differences]}


def fitted(masks: Sequence[np.ndarray], calibration: Sequence[Calibration]) -> tuple[np.ndarray, np.ndarray]:
    """Position and rotation of the cube on the floor with ``UP`` upwards: x, y and yaw from all hand-drawn pixels."""
    rays = sampled(masks, calibration, np.random.default_rng(0), None)
    axis = np.eye(3)[FACES.index(UP) // 2] * (1.0 if UP[0] == "+" else -1.0)
    up = Rotation.align_vectors([[0.0, 0.0, 1.0]], [axis])[0]

    def pose(values: np.ndarray) -> np.ndarray:
        turned = Rotation.from_rotvec([0.0, 0.0, values[2]]) * up
        return np.array([values[0], values[1], c.TRACKED_CUBE_WIDTH_M / 2, *turned.as_rotvec()])

    starts = [(x, y, yaw) for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.0, 0.1) for yaw in np.arange(4) * np.pi / 2 + 0.4]
    found = [
        minimize(
            lambda v: float(cost_px(pose(v)[None], rays, c.TRACKED_CUBE_WIDTH_M)[0]),
            start,
            method="Nelder-Mead",
            options={"xatol": 1e-6, "fatol": 1e-6, "maxiter": 400},
        )
        for start in starts
    ]
    best = pose(min(found, key=lambda each: each.fun).x)
    return best[:3], Rotation.from_rotvec(best[3:]).as_matrix()


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Measure the tracker on images.")
    parser.add_argument("what", choices=("renders", "photographs"))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--views", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    if options.out.exists():
        print(f"error: {options.out} is there; a try that was made is kept", file=sys.stderr)
        return 2
    if options.what == "photographs" and options.photos is None:
        parser.error("photographs needs --photos")
    found = (
        on_photographs(options.photos)
        if options.what == "photographs"
        else on_renders(options.robots, options.views, options.seed)
    )
    document = {"what": options.what, "made_at": datetime.now(UTC).isoformat(timespec="seconds"), **found}
    options.out.write_text(json.dumps(document, indent=1) + "\n")
    print(json.dumps(document, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
