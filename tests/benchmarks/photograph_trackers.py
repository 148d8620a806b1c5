"""Trackers on photographs of a real TriFinger, each try kept.

``python -m tests.benchmarks.photograph_trackers PHOTOS --out FILE``: PHOTOS is the folder ``test/images`` of
``trifinger_object_tracking``. A file that is there is never overwritten. Nothing is developed on the photographs: the reference
comes from the hand-drawn masks alone, with the cube flat on the floor. With ``--floor`` no tracker is tried: it tells how well
the masks and the calibration agree at other heights of the cube.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from scipy.optimize import minimize

from sim_backend.trifinger import constants as c
from sim_backend.vision.calibration import Calibration, calibration_of
from sim_backend.vision.colours import segmented
from sim_backend.vision.image_tracker import ImageTracker, SeenPose
from sim_backend.vision.pose_search import PixelRays, cost_px, face_corners_m
from sim_backend.vision.reference_tracker import sampled, track_by_colours
from sim_backend.vision.rotations import angle_between_rad, matrix_of_quat
from sim_backend.vision.scenes import resting_quat
from sim_backend.vision.seen_pixels import CLASSES, FACES, LIKELY, NETWORK_FILE, STRIDE, outputs_of, probabilities

CAMERAS = ("60", "180", "300")
COLOURS = {"red": "+x", "magenta": "-x", "green": "+y", "yellow": "-y", "blue": "+z", "cyan": "-z"}
WIDTH_M = c.TRACKED_CUBE_WIDTH_M
STARTS_M, YAWS = (-0.1, 0.0, 0.1), 4
HEIGHTS_M = np.round(np.arange(-0.014, 0.0061, 0.002), 4)
DETECTOR_POSITION_M = (-0.063, -0.136, 0.025)
"""What the published detector's own test expects of it on this instant (SOURCE.md)."""
Pose = tuple[np.ndarray, np.ndarray]


def read(path: Path) -> np.ndarray:
    """A photograph at the tracker's size, red first; each pixel is the mean of four."""
    whole = cv2.imread(str(path), cv2.IMREAD_COLOR)
    assert whole is not None, f"{path} is no image"
    return np.ascontiguousarray(cv2.resize(whole, (c.CAMERA_IMAGE_PX,) * 2, interpolation=cv2.INTER_AREA)[..., ::-1])


def hand_mask(files: dict[str, Path]) -> np.ndarray:
    """Classes of pixels by hand-drawn masks, by face, those that are there; shape (270, 270)."""
    out = np.zeros((c.CAMERA_IMAGE_PX,) * 2, np.uint8)
    for face, file in files.items():
        if file.is_file():
            drawn = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
            assert drawn is not None, f"{file} is no image"
            share = cv2.resize((drawn > 0).astype(np.float32), (c.CAMERA_IMAGE_PX,) * 2, interpolation=cv2.INTER_AREA)
            out[share > 0.5] = FACES.index(face) + 1
    return out


def overlaps(found: np.ndarray, drawn: np.ndarray) -> dict[str, float]:
    """Pixels in both over pixels in either, by colour, for those that either has."""
    names, shares = {face: colour for colour, face in COLOURS.items()}, {}
    for number, face in enumerate(FACES, 1):
        both, either = ((found == number) & (drawn == number)).sum(), ((found == number) | (drawn == number)).sum()
        if either:
            shares[names[face]] = round(float(both / either), 3)
    return shares


def network_mask(image: np.ndarray) -> np.ndarray:
    """Classes of pixels as our network sees them, shape (270, 270)."""
    chance = probabilities(outputs_of(image[None])[0])
    full = np.stack([np.kron(each, np.ones((STRIDE, STRIDE))) for each in chance])[:, : image.shape[0], : image.shape[1]]
    best = full[1:].argmax(axis=0) + 1
    assert full.shape[0] == CLASSES
    return np.where(full[0] < 1 - LIKELY, best, 0).astype(np.uint8)


def on_floor(values: np.ndarray, up: int) -> Pose:
    """Position and rotation of a cube that lies flat with a face up: values are x, y in m and the turn about the vertical."""
    return np.array([values[0], values[1], WIDTH_M / 2]), matrix_of_quat(resting_quat(up, float(values[2])))


def fitted(masks: Sequence[np.ndarray], calibrations: Sequence[Calibration], up: int) -> tuple[float, np.ndarray]:
    """Cost and values of the best pose on the floor with a face up: pixels of the masks must lie in the faces of their colour."""
    rays = sampled(masks, calibrations, np.random.default_rng(0), None)

    def cost(values: np.ndarray) -> float:
        position, rotation = on_floor(values, up)
        return _cost(position, rotation, rays)

    grid = [np.array([x, y, yaw]) for x in STARTS_M for y in STARTS_M for yaw in np.arange(YAWS) * np.pi / 2 + 0.4]
    start = min(grid, key=cost)
    found = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-7, "maxiter": 600})
    return float(found.fun), found.x


def _cost(position: np.ndarray, rotation: np.ndarray, rays: Sequence[PixelRays]) -> float:
    return float(cost_px(np.concatenate([position, _vector(rotation)])[None], rays, WIDTH_M)[0])


def _vector(rotation: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_rotvec()


def filled(masks: Sequence[np.ndarray], calibrations: Sequence[Calibration], up: int, start: np.ndarray) -> np.ndarray:
    """Values of the pose whose projected faces overlap the masks best; where the masks are cut by fingers nothing is lost."""

    simplex = start + np.vstack([np.zeros(3), np.diag([0.004, 0.004, 0.06])])
    options = {"xatol": 1e-5, "fatol": 0.5, "maxiter": 400, "initial_simplex": simplex}
    return minimize(lambda values: unlike(masks, calibrations, up, values), start, method="Nelder-Mead", options=options).x


def unlike(
    masks: Sequence[np.ndarray], calibrations: Sequence[Calibration], up: int, values: np.ndarray, raised_m: float = 0.0
) -> float:
    """Pixels in which masks and the faces of a pose differ: one on the floor, raised by so much."""
    position, rotation = on_floor(values, up)
    position, total = position + np.array([0.0, 0.0, raised_m]), 0.0
    for mask, calibration in zip(masks, calibrations, strict=True):
        for face, corners in enumerate(face_corners_m(WIDTH_M), 1):
            outward = rotation @ corners.mean(axis=0)
            if outward @ (calibration.position_world_m - position - outward) > 0:
                pixels = calibration.project(corners @ rotation.T + position)
                drawn = np.zeros(mask.shape, np.uint8)
                cv2.fillPoly(drawn, [np.rint(pixels * 16).astype(np.int32)], 1, cv2.LINE_8, 4)
                both, either = ((drawn > 0) & (mask == face)).sum(), ((drawn > 0) | (mask == face)).sum()
                total += either - both
    return float(total)


def by_height(masks: Sequence[np.ndarray], calibrations: Sequence[Calibration]) -> list[dict[str, float]]:
    """How many pixels of masks and faces differ at best when the cube lies flat, but higher or lower than the floor."""
    costs = [fitted(masks, calibrations, up) for up in range(len(FACES))]
    up = int(np.argmin([cost for cost, _ in costs]))
    start, told = costs[up][1], []
    simplex = start + np.vstack([np.zeros(3), np.diag([0.004, 0.004, 0.06])])
    options = {"xatol": 1e-5, "fatol": 0.5, "maxiter": 400, "initial_simplex": simplex}
    for raised_m in HEIGHTS_M:
        found = minimize(
            lambda values: unlike(masks, calibrations, up, values, raised_m),  # noqa: B023
            start,
            method="Nelder-Mead",
            options=options,
        )
        told.append({"height_mm": round(1000 * raised_m, 1), "pixels_apart": float(found.fun)})
    return told


def reference(masks: Sequence[np.ndarray], calibrations: Sequence[Calibration]) -> tuple[Pose, dict[str, Any]]:
    """The pose on the floor that the hand-drawn masks tell, and how far other ways to read them lead from it."""
    costs = [fitted(masks, calibrations, up) for up in range(len(FACES))]
    up = int(np.argmin([cost for cost, _ in costs]))
    best = costs[up][1]
    whole, others = on_floor(best, up), {"overlap of faces": on_floor(filled(masks, calibrations, up, best), up)}
    for kept in ((0, 1), (0, 2), (1, 2)):
        pair = [masks[k] for k in kept], [calibrations[k] for k in kept]
        others["cameras " + " and ".join(CAMERAS[k] for k in kept)] = on_floor(fitted(*pair, up)[1], up)
    spread = {name: apart(*pose, whole) for name, pose in others.items()}
    told = {
        "position_m": np.round(whole[0], 5).tolist(),
        "rotation": np.round(whole[1], 5).tolist(),
        "up": FACES[up],
        "cost_px": round(costs[up][0], 3),
        "cost_px_other_faces_up": [round(cost, 2) for k, (cost, _) in enumerate(costs) if k != up],
        "other_ways": spread,
        "uncertainty_mm": round(float(np.sqrt(np.mean([each["mm"] ** 2 for each in spread.values()]))), 2),
        "uncertainty_deg": round(float(np.sqrt(np.mean([each["deg"] ** 2 for each in spread.values()]))), 2),
    }
    return whole, told


def apart(position_m: np.ndarray, rotation: np.ndarray, true: Pose) -> dict[str, float]:
    """Distance, height and angle from a pose."""
    return {
        "mm": round(1000 * float(np.linalg.norm(position_m - true[0])), 2),
        "height_mm": round(1000 * float(position_m[2] - true[0][2]), 2),
        "deg": round(float(np.rad2deg(angle_between_rad(true[1], rotation))), 2),
    }


def _found(pose: SeenPose, true: Pose) -> dict[str, Any]:
    deviation = np.sqrt(np.diag(pose.covariance))
    expected = {} if not np.isfinite(deviation).all() else {"expected_mm": round(1000 * float(np.linalg.norm(deviation[:3])), 2)}
    where = np.round(pose.position_world_m, 4).tolist()
    return {
        "position_m": where,
        "confidence": round(pose.confidence, 3),
        **apart(pose.position_world_m, pose.rotation, true),
        **expected,
    }


def drawn_by_hand(place: Path) -> tuple[list[Calibration], list[np.ndarray]]:
    """Calibrations of the cameras and the masks of their images."""
    files = [yaml.safe_load((place / f"camera_calib_{name}.yml").read_text()) for name in CAMERAS]
    calibrations = [calibration_of(file).resized(c.CAMERA_IMAGE_PX) for file in files]
    masks = [hand_mask({face: place / f"{colour[0]}{name}.png" for colour, face in COLOURS.items()}) for name in CAMERAS]
    return calibrations, masks


def one_try(photos: Path) -> dict[str, Any]:
    """Everything that is asked of the photographs, once."""
    place = photos / "pose_detection" / "cube_v2"
    calibrations, drawn = drawn_by_hand(place)
    images = [read(place / f"camera{name}.png") for name in CAMERAS]
    true, told = reference(drawn, calibrations)
    ours = ImageTracker(calibrations, (WIDTH_M, WIDTH_M, WIDTH_M)).track(images)
    by_colours = [track_by_colours(images, calibrations, seed=seed) for seed in range(5)]
    empty = ImageTracker(calibrations, (WIDTH_M, WIDTH_M, WIDTH_M)).track([read(place / f"n{name}.png") for name in CAMERAS])
    detector = 1000 * (np.array(DETECTOR_POSITION_M) - true[0])
    masks = {"ours": network_mask, "as_on_the_real_robot": segmented}
    return {
        "reference": told,
        "ours": _found(ours, true),
        "ours_without_the_cube": {"confidence": round(empty.confidence, 3)},
        "as_on_the_real_robot": [{"seed": seed, **_found(pose, true)} for seed, pose in enumerate(by_colours)],
        "published_detector": {"mm": round(float(np.linalg.norm(detector)), 2), "height_mm": round(float(detector[2]), 2)},
        "overlap_of_masks": {
            name: {
                **{
                    f"pose_detection v2, camera{k}": overlaps(of(image), mask)
                    for k, image, mask in zip(CAMERAS, images, drawn, strict=True)
                },
                **{
                    f"{version} {number}": single(photos / "segmentation" / version, number, of)
                    for version in ("cube_v2", "cube_v3")
                    for number in ("01", "02")
                },
            }
            for name, of in masks.items()
        },
    }


def single(folder: Path, number: str, of: Any) -> dict[str, float]:
    """Overlap of a single photograph's masks with those drawn by hand."""
    drawn = hand_mask({face: folder / f"{number}_mask_{colour}.png" for colour, face in COLOURS.items()})
    return overlaps(of(read(folder / f"{number}_image.png")), drawn)


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Try the trackers on photographs.")
    parser.add_argument("photos", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--floor", action="store_true", help="try no tracker; tell how the masks agree at other heights")
    options = parser.parse_args(arguments)
    if options.out.exists():
        print(f"error: {options.out} is there; a try that was made is kept", file=sys.stderr)
        return 2
    if options.floor:
        calibrations, drawn = drawn_by_hand(options.photos / "pose_detection" / "cube_v2")
        text = json.dumps({"masks_at_heights": by_height(drawn, calibrations)}, indent=1)
        options.out.write_text(text + "\n")
        print(text)
        return 0
    digest = sha256(NETWORK_FILE.read_bytes()).hexdigest()
    told = {"at": datetime.now(UTC).isoformat(timespec="seconds"), "network_sha256": digest, **one_try(options.photos)}
    options.out.write_text(json.dumps(told, indent=1) + "\n")
    print(json.dumps(told, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
