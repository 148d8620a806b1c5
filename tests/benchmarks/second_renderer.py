"""Our tracker on renders of a second renderer, which shares no code with the first and of which nothing was learnt.

``python -m tests.benchmarks.second_renderer --out FILE [--robots 20] [--scenes 3] [--pictures FOLDER]``: PyBullet's software
renderer, in an environment of its own, gets the scenes as triangles with colours. Light, shading and shadows are its own, and
no effect on images is laid over them. The same scenes by MuJoCo's renderer stand beside it. Says why PyBullet cannot be had.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np

from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.vision.appearance import revolved, seen_spec
from sim_backend.vision.calibration import Calibration, nominal_calibrations
from sim_backend.vision.cameras import Cameras, _Pinhole, as_it_stands
from sim_backend.vision.image_tracker import SURE, ImageTracker
from sim_backend.vision.rotations import angle_between_rad, matrix_of_quat
from sim_backend.vision.scenes import Scene, drawn_scene
from tests.benchmarks.own_environment import missing, python_of

ENVIRONMENT, PACKAGES = "pybullet", ("pybullet==3.2.7", "numpy")
PRESET, FIRST_ROBOT = "real-images", 800_000
RINGS = 12
"""Of a half ball, and twice as many around it."""
RENDERING = Path(__file__).with_name("pybullet_renders.py")


def triangles(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3), m, in the geom's frame and triangles (f, 3) of one geom of any kind that the scene has."""
    kind, size, known = int(model.geom_type[geom]), model.geom_size[geom], mujoco.mjtGeom
    if kind == int(known.mjGEOM_MESH):
        mesh = model.geom_dataid[geom]
        at, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        return model.mesh_vert[at : at + count].astype(float), model.mesh_face[face : face + faces].astype(int)
    if kind == int(known.mjGEOM_BOX):
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
        sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        return corners, np.array([part for a, b, c, d in sides for part in ((a, b, c), (a, c, d))])
    angle = np.linspace(-np.pi / 2, np.pi / 2, 2 * RINGS)
    half = 0.0 if kind == int(known.mjGEOM_SPHERE) else size[1]
    if kind == int(known.mjGEOM_CYLINDER):
        profile = np.array([[1e-6, -half], [size[0], -half], [size[0], half], [1e-6, half]])
    else:
        height = size[0] * np.sin(angle) + np.where(angle < 0, -half, half)
        profile = np.stack([np.maximum(size[0] * np.cos(angle), 1e-6), height], axis=1)
    vertices, faces = revolved(profile, 2 * RINGS)
    return vertices, faces[:, ::-1]  # which looks outwards


def written(physics: Physics, scenes: Sequence[Scene], path: Path) -> None:
    """Write what one robot's cameras see of scenes, as ``pybullet_renders.py`` reads it."""
    model = seen_spec(physics).compile()
    data = mujoco.MjData(model)
    geoms = [k for k in range(model.ngeom) if model.geom_group[k] < 3 and model.geom_rgba[k, 3] > 0]
    parts: dict[str, Any] = {"rgba": np.array([model.geom_rgba[k] for k in geoms])}
    for number, geom in enumerate(geoms):
        parts[f"vertices_{number}"], parts[f"faces_{number}"] = triangles(model, geom)
    poses = []
    for scene in scenes:
        data.qpos[:9], data.qpos[9:12], data.qpos[12:16] = scene.joint_position_rad, scene.position_world_m, scene.quat_wxyz
        mujoco.mj_kinematics(model, data)
        poses.append([[*data.geom_xpos[k], *_xyzw(data.geom_xmat[k])] for k in geoms])
    parts |= {"poses": np.array(poses), "light": np.tile(-model.light_dir[0], (len(scenes), 1))}
    cameras = _cameras(physics)
    parts |= {"eye": np.array([each.position_world_m for each in cameras])}
    parts |= {"target": np.array([each.position_world_m + each.rotation[2] for each in cameras])}
    parts |= {"up": np.array([-each.rotation[1] for each in cameras])}
    pinholes = [_Pinhole(each) for each in cameras]
    parts |= {"fov_deg": np.array([np.rad2deg(2 * np.arctan(each._half)) for each in pinholes])}
    np.savez(path, allow_pickle=False, size_px=np.array([each.size_px for each in pinholes]), **parts)


def _xyzw(matrix: np.ndarray) -> np.ndarray:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(matrix).ravel())
    return quat[[1, 2, 3, 0]]


def _cameras(physics: Physics) -> list[Calibration]:
    return [as_it_stands(each, physics, index) for index, each in enumerate(nominal_calibrations())]


def judged_robot(seed: int, scenes: int, pictures: Path | None) -> list[dict[str, Any]]:
    """Rows of one robot: what the tracker makes of a scene by each renderer."""
    rng = np.random.default_rng(seed)
    physics = load_ranges(PRESET).draw(rng, 1)
    drawn, tracker = [drawn_scene(rng) for _ in range(scenes)], ImageTracker(nominal_calibrations())
    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder) / "scenes.npz", Path(folder) / "images.npz"
        written(physics, drawn, given)
        subprocess.run([str(python_of(ENVIRONMENT)), str(RENDERING), str(given), str(out)], check=True, capture_output=True)
        painted = np.load(out)
        painted = [painted[f"camera_{k}"] for k in range(len(painted.files))]
    pinholes, rows = [_Pinhole(each) for each in _cameras(physics)], []
    with Cameras(physics) as cameras:
        for number, scene in enumerate(drawn):
            pairs = zip(pinholes, painted, strict=True)
            second = [np.clip(np.rint(pinhole.seen(each[number])), 0, 255).astype(np.uint8) for pinhole, each in pairs]
            first = cameras.take(scene.joint_position_rad, scene.position_world_m, scene.quat_wxyz, seed=seed, frame=number)
            row: dict[str, Any] = {"robot": seed, "scene": number}
            for name, images in (("pybullet", second), ("mujoco", first)):
                tracker.forget()
                found = tracker.track(np.array(images))
                off_m = np.linalg.norm(found.position_world_m - scene.position_world_m)
                turned = np.rad2deg(angle_between_rad(found.rotation, matrix_of_quat(scene.quat_wxyz)))
                row[name] = {"mm": round(1000 * float(off_m), 3), "deg": round(float(turned), 3)}
                row[name] |= {"confidence": round(found.confidence, 4)}
            rows.append(row)
            if pictures is not None:
                both = np.concatenate([np.concatenate(list(each), axis=1) for each in (second, first)])
                cv2.imwrite(str(pictures / f"{seed}-{number}.png"), both[..., ::-1])
    return rows


def summary(rows: Sequence[dict[str, Any]], name: str) -> dict[str, Any]:
    """Medians and 95th percentiles of what counts as seen."""
    seen = [row[name] for row in rows if row[name]["confidence"] >= SURE]
    told: dict[str, Any] = {"frames": len(rows), "not_seen": round(1 - len(seen) / len(rows), 4)}
    for unit in ("mm", "deg"):
        values = [each[unit] for each in seen]
        told |= {
            f"{what}_{unit}": round(float(np.percentile(values, at)), 2) for what, at in (("median", 50), ("p95", 95)) if seen
        }
    return told


def main(arguments: list[str] | None = None) -> int:
    """The command; see the module's docstring."""
    parser = argparse.ArgumentParser(description="Judge our tracker on a second renderer.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--scenes", type=int, default=3)
    parser.add_argument("--first", type=int, default=FIRST_ROBOT)
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args(arguments)
    if (reason := missing(ENVIRONMENT, PACKAGES)) is not None:
        sys.exit(reason)
    rows: list[dict[str, Any]] = []
    told: dict[str, Any] = {}
    for seed in range(options.first, options.first + options.robots):
        rows += judged_robot(seed, options.scenes, options.pictures)
        told = {name: summary(rows, name) for name in ("pybullet", "mujoco")}
        about = {"at": datetime.now(UTC).isoformat(timespec="seconds"), "preset": PRESET, "robots": [options.first, seed]}
        options.out.write_text(json.dumps(about | told | {"rows": rows}, indent=1) + "\n")
    print(json.dumps(told))
    return 0


if __name__ == "__main__":
    sys.exit(main())
