"""What errors the tracker on images has, and the formula in the same scenes: renders of randomised robots, one row a scene.

Each scene is looked at three times. The second look differs by the images' noise alone; in the third the cube has moved on for
one frame and the tracker begins with where it was, so that errors are known at rest and at speed.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_backend.driver.detection import detect, values_of
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE
from sim_backend.vision.calibration import nominal_calibrations
from sim_backend.vision.cameras import Cameras
from sim_backend.vision.image_tracker import ImageTracker, SeenPose
from sim_backend.vision.rotations import matrices_of, matrix_of_quat, quat_of_matrix
from sim_backend.vision.scenes import Scene, drawn_scene
from sim_backend.vision.shown import hidden_share, shown_share

PRESET, FIRST_ROBOT = "real-images", 700_000
"""Robots are drawn from these seeds on; no training and no other judgement has them."""
FASTEST_M_S, TURNING_RAD_S = 0.5, 3.0
"""Of the third look: the cube's speed is anything up to that, in any direction."""
LOOKS = ("at_rest", "again", "moved")


@dataclass(frozen=True)
class Error:
    """A pose's error: position in m and rotation vector in rad in the world's frame, shape (3,) each, and its confidence."""

    position_m: np.ndarray
    rotation_rad: np.ndarray
    confidence: float

    def document(self) -> dict[str, Any]:
        """As it is kept."""
        return {
            "position_mm": np.round(1000 * self.position_m, 3).tolist(),
            "rotation_rad": np.round(self.rotation_rad, 5).tolist(),
            "confidence": round(self.confidence, 4),
        }


def error_of(position_m: np.ndarray, rotation: np.ndarray, confidence: float, scene: Scene) -> Error:
    """How far a pose (3,), (3, 3) is from a scene's."""
    turn = rotation @ matrix_of_quat(scene.quat_wxyz).T
    return Error(position_m - scene.position_world_m, rotation_vector(turn), confidence)


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """The rotation vector (3,) of a matrix (3, 3), of at most half a turn, rad."""
    w, *axis = quat_of_matrix(matrix)
    sign, length = (1.0 if w >= 0 else -1.0), float(np.linalg.norm(axis))
    return np.zeros(3) if length < 1e-12 else 2.0 * np.arctan2(length, abs(w)) * sign * np.array(axis) / length


def errors_of_robot(seed: int, scenes: int) -> list[dict[str, Any]]:
    """Rows of one robot.

    Args:
        seed: of the robot and of its scenes.
        scenes: how many.

    Returns:
        For each scene: the share that is hidden, the distance from the middle of the arena and from the floor, the speed of the
        third look, light and exposure, errors of the tracker on images in each look and of the formula in the first.

    Raises:
        CamerasMissingError: this machine cannot render.
    """
    rng = np.random.default_rng(seed)
    physics = load_ranges(PRESET).draw(rng, 1)
    half_m, rows = c.CUBE_WIDTH_M / 2 * float(physics.value("cube_size.factor")[0]), []
    with Cameras(physics) as cameras:
        for number in range(scenes):
            scene, (later, speed_m_s) = (drawn := drawn_scene(rng)), moved_on(drawn, rng)
            faces = cameras.labels(*_state(scene))
            shown = [shown_share(face, each, scene, half_m) for face, each in zip(faces, cameras.true_calibrations, strict=True)]
            tracker, found = ImageTracker(nominal_calibrations()), {}
            for frame, (name, looked_at) in enumerate(zip(LOOKS, (scene, scene, later), strict=True)):
                if name == "again":
                    tracker.forget()
                pose = tracker.track(cameras.take(*_state(looked_at), seed=seed, frame=3 * number + frame))
                found[name] = _of_images(pose, looked_at).document()
            rows.append(_about(seed, number, scene, physics) | {"hidden": round(hidden_share(shown), 4)})
            rows[-1] |= {
                "speed_m_s": round(speed_m_s, 4),
                "images": found,
                "formula": formula_error(physics, seed, number, scene),
            }
    return rows


def formula_error(physics: Physics, seed: int, frame: int, scene: Scene) -> dict[str, Any]:
    """The error of the formula for a robot (n = 1) in a scene, as it is kept."""
    noise = np.array([seed]), np.array([frame])
    _, confidence, position, quat, _, _ = detect(values_of(physics, CUBE.size_m), *noise, *(each[None] for each in _state(scene)))
    return error_of(position[0], matrix_of_quat(quat[0]), float(confidence[0]), scene).document()


def moved_on(scene: Scene, rng: np.random.Generator) -> tuple[Scene, float]:
    """The scene one frame later, the cube at some speed in any direction and turning with it; and that speed, m/s."""
    speed_m_s = float(rng.uniform(0.0, FASTEST_M_S))
    way, axis = (each / np.linalg.norm(each) for each in rng.standard_normal((2, 3)))
    position = scene.position_world_m + way * speed_m_s * c.CAMERA_PERIOD_S
    position[2] = max(position[2], scene.position_world_m[2])
    turn = matrices_of((axis * TURNING_RAD_S * speed_m_s / FASTEST_M_S * c.CAMERA_PERIOD_S)[None])[0]
    rotation = turn @ matrix_of_quat(scene.quat_wxyz)
    return Scene(scene.joint_position_rad, position, quat_of_matrix(rotation)), speed_m_s


def _of_images(pose: SeenPose, scene: Scene) -> Error:
    return error_of(pose.position_world_m, pose.rotation, pose.confidence, scene)


def _state(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return scene.joint_position_rad, scene.position_world_m, scene.quat_wxyz


def _about(seed: int, number: int, scene: Scene, physics: Physics) -> dict[str, Any]:
    x, y, z = scene.position_world_m
    joints = np.round(scene.joint_position_rad, 5).tolist()
    return {
        "robot": seed,
        "scene": number,
        "joint_position_rad": joints,
        "position_m": np.round(scene.position_world_m, 5).tolist(),
        "quat_wxyz": np.round(scene.quat_wxyz, 6).tolist(),
        "from_middle_m": round(float(np.hypot(x, y)), 4),
        "height_m": round(float(z), 4),
        "lamp": round(float(physics.value("lamp.strength")[0]), 3),
        "stops": np.round(physics.value("exposure.stops")[0], 3).tolist(),
    }
