"""Renders scenes of triangles with PyBullet's software renderer, in an environment of its own that has nothing of this project.

``python pybullet_renders.py SCENES.npz OUT.npz``; started by ``second_renderer.py``, which writes what is to be seen.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np


def main() -> None:
    """The command; see the module's docstring."""
    import pybullet

    given = np.load(sys.argv[1])
    pybullet.connect(pybullet.DIRECT)
    with tempfile.TemporaryDirectory() as folder:
        bodies = []
        for number, rgba in enumerate(given["rgba"]):
            path = Path(folder) / f"{number}.obj"
            vertices, faces = given[f"vertices_{number}"], given[f"faces_{number}"]
            lines = [f"v {x} {y} {z}" for x, y, z in vertices.tolist()]
            path.write_text("\n".join(lines + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()]) + "\n")
            shape = pybullet.createVisualShape(pybullet.GEOM_MESH, fileName=str(path), rgbaColor=rgba.tolist())
            bodies.append(pybullet.createMultiBody(0, -1, shape))
        images = [_seen(pybullet, given, bodies, scene) for scene in range(len(given["poses"]))]
    cameras = {f"camera_{k}": np.array([each[k] for each in images]) for k in range(len(given["eye"]))}
    np.savez_compressed(sys.argv[2], allow_pickle=False, **cameras)


def _seen(pybullet, given, bodies, scene: int) -> list[np.ndarray]:
    """The images of one scene by all cameras, shape (size, size, 3) each."""
    for body, pose in zip(bodies, given["poses"][scene].tolist(), strict=True):
        pybullet.resetBasePositionAndOrientation(body, pose[:3], pose[3:])
    images = []
    for each in zip(*(given[name].tolist() for name in ("eye", "target", "up", "fov_deg", "size_px")), strict=True):
        eye, target, up, fov_deg, size = each
        _, _, pixels, _, _ = pybullet.getCameraImage(
            size,
            size,
            pybullet.computeViewMatrix(eye, target, up),
            pybullet.computeProjectionMatrixFOV(fov_deg, 1.0, 0.05, 3.0),
            lightDirection=given["light"][scene].tolist(),
            shadow=1,
            renderer=pybullet.ER_TINY_RENDERER,
        )
        images.append(np.reshape(np.array(pixels, np.uint8), (size, size, 4))[..., :3])
    return images


if __name__ == "__main__":
    main()
