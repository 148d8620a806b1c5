"""The README's moving picture: one trial from its log, drawn by MuJoCo.

``MUJOCO_GL=egl PYTHONPATH=. python docs/pictures/moving_picture.py LOG OUT.gif [FROM_S TO_S]``

LOG is a trial of a nominal robot, which holds the true pose of the cube. ``docs/pictures/lift.gif`` is trial 1, 0 to 7 s, of
``trifarm demo --task lift --trials 4 --robots 1 --physics nominal`` with ``reference_policies/lift.safetensors``. Needs pyopengl,
libegl1 and libgl1-mesa-dri.
"""

import sys
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from sim_backend.trifinger.scene import build_scene
from trial_logs.reader import TrialLog, read_log

WIDTH_PX, HEIGHT_PX = 480, 320
FRAMES_PER_S = 12.5
COLOURS = 96
GOAL_RGBA = (1.0, 0.62, 0.1, 0.4)
SKY_RGB = (0.93, 0.94, 0.96)


def frames(log: TrialLog, from_s: float, to_s: float) -> list[Image.Image]:
    """Pictures of the trial between two times, s, at ``FRAMES_PER_S``; the wanted pose is orange."""
    model = _model(log)
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance, camera.azimuth, camera.elevation = (0.0, 0.0, 0.08), 0.72, 158.0, -24.0
    pictures = []
    with mujoco.Renderer(model, HEIGHT_PX, WIDTH_PX) as renderer:
        for time_s in np.arange(from_s, to_s, 1 / FRAMES_PER_S):
            joint = np.searchsorted(log.joint_steps, 1000 * time_s)
            cube = np.searchsorted(log.cube_steps, 1000 * time_s)
            data.qpos[:9] = log.joint_position_rad[joint]
            data.qpos[9:12], data.qpos[12:16] = log.cube_position_world_m[cube], log.cube_quat_wxyz[cube]
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            pictures.append(Image.fromarray(renderer.render()))
    return pictures


def _model(log: TrialLog) -> mujoco.MjModel:
    """The scene of the simulation, lit for people, with the goal in it."""
    spec = build_scene()
    spec.add_texture(
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=SKY_RGB,
        rgb2=SKY_RGB,
        width=8,
        height=8,
    )
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.30] * 3, [0.30] * 3
    spec.worldbody.add_light(
        pos=[0.5, -0.5, 1.2], dir=[-0.4, 0.4, -1.0], castshadow=True, diffuse=[0.45] * 3, specular=[0.05] * 3
    )
    for geom in spec.geoms:
        if geom.name.startswith("wall"):
            geom.rgba = [0.0, 0.0, 0.0, 0.0]  # it stands in the way of the eye
        elif geom.name == "table":
            geom.rgba = [0.50, 0.52, 0.56, 1.0]
            geom.size = [0.30, 0.30, 0.05]
    if log.goal is not None:
        position_m, quat_wxyz = log.goal
        side_m = spec.geom("cube").size[0]
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[side_m] * 3,
            pos=position_m,
            quat=quat_wxyz,
            rgba=GOAL_RGBA,
            contype=0,
            conaffinity=0,
        )
    return spec.compile()


def main(log: str, out: str, from_s: str = "0", to_s: str = "10") -> None:
    """Write the picture."""
    pictures = frames(read_log(log), float(from_s), float(to_s))
    palette = pictures[len(pictures) // 2].quantize(COLOURS)
    small = [each.quantize(COLOURS, palette=palette, dither=Image.Dither.NONE) for each in pictures]
    small[0].save(out, save_all=True, append_images=small[1:], duration=round(1000 / FRAMES_PER_S), loop=0, optimize=True)
    print(f"{out}: {len(small)} frames, {Path(out).stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(*sys.argv[1:])
