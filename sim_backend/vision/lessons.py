"""What the tracker's network learns from: crops of rendered images of randomised robots, and what each pixel shows of the cube.

``python -m sim_backend.vision.lessons --out DIR`` renders them in a process without torch (two LLVMs do not go together); a
robot whose file is there is not rendered again. Images alone of this project's renders go in, no photograph.
"""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sim_backend.effects.ranges import load_ranges
from sim_backend.trifinger import constants as c
from sim_backend.vision.calibration import Calibration
from sim_backend.vision.cameras import Cameras, CamerasMissingError
from sim_backend.vision.rotations import matrix_of_quat
from sim_backend.vision.scenes import Scene, drawn_scene

PRESET = "real-images"
CROP_PX = 128
SCENES_OF_A_ROBOT = 16
_BESIDE_PX = 20
"""How far the cube may lie from the middle of its crop."""


def render_robot(seed: int, scenes: int = SCENES_OF_A_ROBOT) -> dict[str, np.ndarray]:
    """Crops of one robot's images.

    Args:
        seed: of the robot and its scenes.
        scenes: how many.

    Returns:
        ``image`` (n, CROP_PX, CROP_PX, 3), uint8, red first; ``face`` (n, CROP_PX, CROP_PX), uint8: 0 for none, else the place in
        ``CUBE_FACE_COLOURS`` plus 1; ``place`` (n, CROP_PX, CROP_PX, 3), int8: the point of the cube that the pixel shows, in
        127ths of half its width. Three crops of a scene are at the cube, one for each camera, and one is anywhere.
    """
    rng = np.random.default_rng(seed)
    physics, kept = load_ranges(PRESET).draw(rng, 1), []
    half_m = c.CUBE_WIDTH_M / 2 * float(physics.value("cube_size.factor")[0])
    with Cameras(physics) as cameras:
        views = [directions(each) for each in cameras.true_calibrations]
        for number in range(scenes):
            scene = drawn_scene(rng)
            state = scene.joint_position_rad, scene.position_world_m, scene.quat_wxyz
            images, faces = cameras.take(*state, seed=seed, frame=number), cameras.labels(*state)
            for camera, calibration in enumerate(cameras.true_calibrations):
                at = np.rint(calibration.project(scene.position_world_m)).astype(int) + rng.integers(
                    -_BESIDE_PX, _BESIDE_PX + 1, 2
                )
                kept.append(_crop(images[camera], faces[camera], calibration, views[camera], scene, half_m, at))
            camera, at = int(rng.integers(3)), rng.integers(0, c.CAMERA_IMAGE_PX, 2)
            kept.append(_crop(images[camera], faces[camera], cameras.true_calibrations[camera], views[camera], scene, half_m, at))
    image, face, place = (np.stack(each) for each in zip(*kept, strict=True))
    return {"image": image, "face": face, "place": place}


def directions(calibration: Calibration) -> np.ndarray:
    """Where each pixel looks in the world, shape (height, width, 3)."""
    columns, rows = np.meshgrid(*(np.arange(size) for size in calibration.size_px))
    flat = calibration.normalised(np.stack([columns, rows], axis=-1))
    return np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1) @ calibration.rotation


def _crop(
    image: np.ndarray,
    face: np.ndarray,
    calibration: Calibration,
    direction: np.ndarray,
    scene: Scene,
    half_m: float,
    middle: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    column, row = np.clip(middle - CROP_PX // 2, 0, np.array(calibration.size_px) - CROP_PX)
    window = slice(row, row + CROP_PX), slice(column, column + CROP_PX)
    turn = matrix_of_quat(scene.quat_wxyz)
    eye = (calibration.position_world_m - scene.position_world_m) @ turn
    place = on_faces(face[window], eye / half_m, direction[window] @ turn / half_m)
    return image[window], face[window], np.rint(127 * np.clip(place, -1, 1)).astype(np.int8)


def on_faces(face: np.ndarray, eye: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Points where rays meet the planes of faces, in the cube's frame and half its width; zeros where there is no face.

    Args:
        face: shape (...,): 0 for none, else the place in ``CUBE_FACE_COLOURS`` plus 1.
        eye: where the rays begin, shape (3,).
        direction: shape (..., 3).
    """
    axis, sign = np.maximum(face.astype(int) - 1, 0) // 2, 1.0 - 2.0 * ((face.astype(int) - 1) % 2)
    along = np.take_along_axis(direction, axis[..., None], axis=-1)[..., 0]
    far = (sign - eye[axis]) / np.where(np.abs(along) > 1e-9, along, 1e-9)
    return np.where((face > 0)[..., None], eye + far[..., None] * direction, 0.0)


def render(folder: Path, seeds: Sequence[int], *, tell: bool = True) -> None:
    """Render robots that are not there yet, one file each."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        path = folder / f"robot-{seed}.npz"
        if not path.exists():
            began = time.process_time()
            unfinished = path.with_name(f".part-{os.getpid()}-{path.name}")
            np.savez(unfinished, allow_pickle=False, **render_robot(seed))
            unfinished.replace(path)
            if tell:
                print(f"{path.name}: {time.process_time() - began:.1f} s", flush=True)


def main() -> None:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Render what the tracker's network learns from.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--robots", type=int, default=150)
    options = parser.parse_args()
    try:
        render(options.out, range(options.first, options.first + options.robots))
    except CamerasMissingError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
