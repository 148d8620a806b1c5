"""The scene as cameras see it: floor, wall, paint, light and the robot's shape, on top of the robot's own model.

What moves is that of the robot's model with its effects (sizes, masses do not matter here); what only shows is made here, so that
neither the driver's model nor the form of the scene knows of it. Colours are read from photographs of the real robot with other
cubes than those that trackers are judged by (trifinger_object_tracking @78ec981, test/images/segmentation/cube_v2).
"""

import importlib.util
from pathlib import Path

import mujoco
import numpy as np

from sim_backend.driver.robot_model import robot_spec
from sim_backend.effects.catalogue import CATALOGUE
from sim_backend.effects.effect import Acts
from sim_backend.effects.looking import FLOOR, LAMP, WALL
from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE, Kind, Shape
from sim_backend.trifinger.scene import VISUAL_GROUP

MESH_PACKAGE = "robot_properties_fingers"
"""PyPI, BSD-3-Clause, Max Planck Gesellschaft; ``pip install --no-deps``, since it names a whole dynamics library."""
_MESH_FILES = {"upper": "prox-sim", "middle": "int_sim", "lower": "tip_link_sim", "tip": "tip_sim"}
"""Visual meshes of the Pro finger by link, each in its link's frame (RPF urdf/pro/trifingerpro.urdf)."""
_MOTOR, _MOTOR_PLACES = "motor_sim", {"upper": (0.01569, 0.1643, 0.0), "middle": (0.0488, 0.0, -0.0462)}  # same file
_HIDDEN_GROUP = 4
"""Of geoms that are not rendered: those that only touch."""

WHITE, TIP_GREY, MOTOR_GREY = (0.80, 0.78, 0.77, 1.0), (0.33, 0.35, 0.37, 1.0), (0.16, 0.14, 0.13, 1.0)
FLOOR_GREY, WALL_GREY, OUTSIDE = (0.24, 0.24, 0.24, 1.0), (0.62, 0.62, 0.66, 1.0), (0.03, 0.03, 0.03, 1.0)
FACE_PAINT = {
    "+x": (0.66, 0.18, 0.02),  # red
    "-x": (0.62, 0.46, 0.70),  # magenta
    "+y": (0.50, 0.74, 0.30),  # green
    "-y": (0.92, 0.84, 0.39),  # yellow
    "+z": (0.02, 0.14, 0.33),  # blue
    "-z": (0.50, 0.77, 0.76),  # cyan
}
"""Medians within the hand-drawn masks; those of faces that stand upright there are divided by ``SIDE_LIGHT``."""
SIDE_LIGHT = 0.6
"""Share of the light that an upright face gets of one that looks up: yellow 0.94 above, 0.51 to 0.60 at its sides."""
_PAINTED_SHARE = 0.985
"""Of a face's width: what is left is the printed edge."""
_RIM_M, _OUTER_M = 0.012, 0.6


def seen_spec(physics: Physics, *, shape: Shape = CUBE) -> mujoco.MjSpec:
    """Specification of what is rendered of one robot (n = 1), with its effects of ``Acts.APPEARANCE``.

    Its joints, and so qpos, are those of ``build_scene``.
    """
    spec = robot_spec(physics, shape=shape, physics_step_s=c.PHYSICS_STEP_S)
    for unseen in (*spec.cameras, *spec.lights):
        spec.delete(unseen)
    _hide_arena(spec)
    _add_arena(spec)
    _dress_fingers(spec)
    _paint_faces(spec, shape)
    _add_light(spec)
    for effect in CATALOGUE.values():
        if effect.acts is Acts.APPEARANCE and physics.has(effect.name):
            effect.apply(spec, {p.name: physics.value(effect.key(p))[0] for p in effect.all_parameters})
    return spec


def mesh_folder() -> Path | None:
    """Where the robot's visual meshes lie on this machine; None without the package, which is not imported."""
    found = importlib.util.find_spec(MESH_PACKAGE)
    if found is None or not found.submodule_search_locations:
        return None
    folder = Path(next(iter(found.submodule_search_locations))) / "meshes" / "pro"
    wanted = (*_MESH_FILES.values(), _MOTOR)
    return folder if all((folder / f"{name}.stl").is_file() for name in wanted) else None


def _hide_arena(spec: mujoco.MjSpec) -> None:
    for geom in spec.geoms:
        if geom.name == "table" or geom.name.startswith("wall"):
            geom.group = _HIDDEN_GROUP


def _add_arena(spec: mujoco.MjSpec) -> None:
    """The floor as a disc, the wall as a surface of revolution with its rim, and the dark outside of it."""
    inner, outer = c.WALL_PROFILE_M[0][0], c.WALL_PROFILE_M[-1]
    rim = (outer[0] + _RIM_M, outer[1])
    parts = (
        (FLOOR, ((0.0, 0.0), (inner, 0.0)), FLOOR_GREY),
        (WALL, (*c.WALL_PROFILE_M, rim, (rim[0], rim[1] - 0.01)), WALL_GREY),
        ("outside", ((rim[0], -0.02), (_OUTER_M, -0.02)), OUTSIDE),
    )
    for name, profile_m, rgba in parts:
        vertices, faces = revolved(np.array(profile_m))
        spec.add_mesh(name=f"seen_{name}", uservert=vertices.ravel(), userface=faces.ravel(), inertia=_SHELL)
        spec.worldbody.add_geom(
            name=f"seen_{name}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"seen_{name}", rgba=rgba, **_SHOWS
        )


_SHELL = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
_SHOWS = {"contype": 0, "conaffinity": 0, "group": VISUAL_GROUP, "mass": 0.0}


def revolved(profile_m: np.ndarray, segments: int = 72) -> tuple[np.ndarray, np.ndarray]:
    """A surface of revolution about z that looks upwards and inwards.

    Args:
        profile_m: radius and height of its rings from the inside, shape (k, 2), m.
        segments: around the axis.

    Returns:
        Vertices, shape (k * segments, 3), m, and triangles of them, shape (2 * (k - 1) * segments, 3).
    """
    angle = 2 * np.pi * np.arange(segments) / segments
    radius, height = profile_m[:, :1], profile_m[:, 1:]
    vertices = np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.broadcast_to(height, (len(radius), segments))], axis=2
    )
    here = np.arange(segments)
    there = (here + 1) % segments
    triangles = []
    for ring in range(len(profile_m) - 1):
        low, high = ring * segments, (ring + 1) * segments
        triangles.append(np.stack([low + here, high + here, high + there], axis=1))
        triangles.append(np.stack([low + here, high + there, low + there], axis=1))
    return vertices.reshape(-1, 3), np.concatenate(triangles)


def _dress_fingers(spec: mujoco.MjSpec) -> None:
    """Give the fingers their meshes; without them the primitives that touch are painted like the robot."""
    folder = mesh_folder()
    if folder is not None:
        for name in (*_MESH_FILES.values(), _MOTOR):
            spec.add_mesh(name=name, file=str(folder / f"{name}.stl"), inertia=_SHELL)
    for finger in c.FINGER_NAMES:
        for link, mesh in _MESH_FILES.items():
            body, rgba = spec.body(f"{finger}_{link}"), TIP_GREY if link == "tip" else WHITE
            for geom in body.geoms:
                geom.rgba = rgba
                if folder is not None:
                    geom.group = _HIDDEN_GROUP
            if folder is not None:
                body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, rgba=rgba, **_SHOWS)
                if link in _MOTOR_PLACES:
                    where = _MOTOR_PLACES[link]
                    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=_MOTOR, pos=where, rgba=MOTOR_GREY, **_SHOWS)


def _paint_faces(spec: mujoco.MjSpec, shape: Shape) -> None:
    for face, colour in FACE_PAINT.items():
        geom = spec.geom(f"cube_face_{face}")
        geom.rgba = [*colour, 1.0]
        if shape.kind is Kind.BOX:
            half, axis = np.asarray(spec.geom("cube").size)[:3], "xyz".index(face[1])
            size = half * _PAINTED_SHARE
            size[axis] = np.asarray(geom.size)[axis]
            geom.size = size


def _add_light(spec: mujoco.MjSpec) -> None:
    """Light from everywhere, and a lamp above; together a face that looks up shows its paint as it is."""
    spec.visual.headlight.active = 0
    spec.worldbody.add_light(
        name=LAMP,
        pos=[0.0, 0.0, 1.5],
        dir=[0.0, 0.0, -1.0],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        ambient=[SIDE_LIGHT] * 3,
        diffuse=[1.0 - SIDE_LIGHT] * 3,
        specular=[0.4] * 3,
        castshadow=False,
    )
