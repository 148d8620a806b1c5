"""How much of a cube the images show: what fingers hide of its projection."""

from collections.abc import Sequence

import numpy as np

from sim_backend.vision.calibration import Calibration
from sim_backend.vision.pictures import opencv
from sim_backend.vision.pose_search import face_corners_m
from sim_backend.vision.rotations import matrix_of_quat
from sim_backend.vision.scenes import Scene

_EDGE_PX = 2


def shown_share(face: np.ndarray, calibration: Calibration, scene: Scene, half_m: float) -> tuple[float, float]:
    """Share of the cube's projection whose pixels show it, and how many pixels the projection has.

    Args:
        face: what each pixel shows, shape (height, width), as ``Cameras.labels`` tells it.
        calibration: of the camera as it truly stands.
        scene: where the cube is.
        half_m: half its true width.
    """
    cv2 = opencv()
    corners = face_corners_m(2 * half_m).reshape(-1, 3) @ matrix_of_quat(scene.quat_wxyz).T + scene.position_world_m
    whole = float(cv2.contourArea(cv2.convexHull(calibration.project(corners).astype(np.float32))))
    edge = cv2.morphologyEx((face > 0).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((_EDGE_PX + 1,) * 2, np.uint8))
    return min(float(edge.sum()) / max(whole, 1.0), 1.0), whole


def hidden_share(shown: Sequence[tuple[float, float]]) -> float:
    """Share of the cube that fingers hide in all images together, from what :func:`shown_share` gives of each."""
    share, pixels = np.array(shown).T
    return float(np.clip(1.0 - share @ pixels / max(pixels.sum(), 1.0), 0.0, 1.0))
