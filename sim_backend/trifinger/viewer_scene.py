"""The robot as Foxglove and Lichtblick draw it: primitives fixed to frames, and the moving transforms of those frames."""

import functools

import numpy as np
from foxglove import messages as fm
from mujoco import MjsGeom

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE, Kind, Shape, corners_m
from sim_backend.trifinger.scene import build_scene

WORLD = "world"
TRACKED_CUBE = "cube_tracked"
MEASURED_FRAMES = (
    *(
        (f"{finger}_{'base' if i == 0 else c.LINKS[i - 1].name}", f"{finger}_{c.LINKS[i].name}")
        for finger in c.FINGER_NAMES
        for i in range(3)
    ),
    (WORLD, TRACKED_CUBE),
)
"""(parent, child) of the transforms that move, in the order of :func:`measured_transforms`."""

_ORIGINS_M = np.array([link.origin_m for link in c.LINKS[:3]] * 3)
_AXES = np.array([link.joint_axis for link in c.LINKS[:3]] * 3)
"""Of the nine joints, shape (9, 3) both."""
_BLACK = fm.Color(r=0.1, g=0.1, b=0.1, a=1.0)
_COLOURS = {
    name: fm.Color(r=red, g=green, b=blue, a=1.0)
    for name, (red, green, blue) in zip(c.FINGER_NAMES, ((0.16, 0.62, 0.58), (0.85, 0.45, 0.16), (0.48, 0.42, 0.86)), strict=True)
}
"""By which fingers are told apart, the same as on the pages."""
_LABEL_PX = 14.0


def measured_transforms(joint_position_rad: np.ndarray, position_world_m: np.ndarray, quat_wxyz: np.ndarray) -> np.ndarray:
    """Rows for ``MEASURED_FRAMES``.

    Args:
        joint_position_rad: shape (n, 9).
        position_world_m: the tracked cube, shape (n, 3), m.
        quat_wxyz: the tracked cube, shape (n, 4).

    Returns:
        Shape (n, 70): per frame x, y, z in m and quaternion wxyz.
    """
    rows, half_rad = np.empty((len(joint_position_rad), len(MEASURED_FRAMES), 7)), joint_position_rad / 2
    rows[:, :9, :3] = _ORIGINS_M
    rows[:, :9, 3] = np.cos(half_rad)
    rows[:, :9, 4:] = np.sin(half_rad)[:, :, None] * _AXES
    rows[:, 9, :3], rows[:, 9, 3:] = position_world_m, quat_wxyz
    return rows.reshape(len(rows), 7 * len(MEASURED_FRAMES))


def fixed_transforms() -> bytes:
    """An encoded message with the transforms that never move: the finger bases and the tips."""
    transforms = []
    for finger, yaw in zip(c.FINGER_NAMES, c.FINGER_YAW_RAD, strict=True):
        base = (0.0, 0.0, c.FINGER_BASE_HEIGHT_M)
        turned = fm.Quaternion(w=float(np.cos(yaw / 2)), x=0.0, y=0.0, z=float(np.sin(yaw / 2)))
        transforms.append(_transform(WORLD, f"{finger}_base", base, turned))
        transforms.append(_transform(f"{finger}_lower", f"{finger}_tip", c.LINKS[3].origin_m, _IDENTITY))
    return fm.FrameTransforms(transforms=transforms).encode()


def measured_scene(
    goal_position_world_m: np.ndarray | None,
    goal_quat_wxyz: np.ndarray | None,
    goal_fingertips_world_m: np.ndarray | None,
    shape: Shape = CUBE,
) -> bytes:
    """An encoded scene of arena, fingers, tracked object and, translucent, the goal: a cube or, for ``reach``, fingertips."""
    entities = [_arena(), *(_link(finger, link.name) for finger in c.FINGER_NAMES for link in c.LINKS)]
    entities += [_label(finger) for finger in c.FINGER_NAMES]
    ghost = fm.Color(r=1.0, g=1.0, b=1.0, a=0.25)
    entities.append(_entity(TRACKED_CUBE, TRACKED_CUBE, **_object(shape, 1.01, ghost)))
    if goal_position_world_m is not None and goal_quat_wxyz is not None:
        w, x, y, z = (float(v) for v in goal_quat_wxyz)
        goal = fm.Pose(position=_vector(goal_position_world_m), orientation=fm.Quaternion(w=w, x=x, y=y, z=z))
        entities.append(_entity("goal", WORLD, cubes=[_cube(goal, c.CUBE_WIDTH_M, fm.Color(r=0.2, g=0.9, b=0.3, a=0.35))]))
    if goal_fingertips_world_m is not None:
        colour, size = fm.Color(r=0.2, g=0.9, b=0.3, a=0.5), _vector([2 * c.TIP_RADIUS_M] * 3)
        tips = goal_fingertips_world_m.reshape(3, 3)
        spheres = [fm.SpherePrimitive(pose=_pose(tip), size=size, color=colour) for tip in tips]
        entities.append(_entity("goal", WORLD, spheres=spheres))
    return fm.SceneUpdate(entities=entities).encode()


def true_scene(shape: Shape = CUBE) -> bytes:
    """An encoded scene of the object with the six colours of its sides, in the frame ``cube``."""
    colours = [fm.Color(r=red, g=green, b=blue, a=1.0) for red, green, blue in c.CUBE_FACE_COLOURS.values()]
    if shape.kind is not Kind.BOX:
        white = fm.Color(r=0.9, g=0.9, b=0.9, a=1.0)
        parts = _object(shape, 1.0, white)
        spheres = [
            fm.SpherePrimitive(pose=_pose(centre), size=_vector([0.1 * shape.size_m[0]] * 3), color=colour)
            for centre, colour in zip(_side_centres_m(shape), colours, strict=True)
        ]
        return fm.SceneUpdate(
            entities=[_entity("cube", "cube", **parts | {"spheres": [*parts.get("spheres", []), *spheres]})]
        ).encode()
    cubes = []
    for centre, colour in zip(_side_centres_m(shape), colours, strict=True):
        size = np.where(centre == 0.0, 0.98, 0.02) * shape.size_m
        cubes.append(fm.CubePrimitive(pose=_pose(0.98 * centre), size=_vector(size), color=colour))
    return fm.SceneUpdate(entities=[_entity("cube", "cube", cubes=cubes)]).encode()


def _side_centres_m(shape: Shape) -> np.ndarray:
    """Centres of the sides in the order of ``CUBE_FACE_COLOURS``, shape (6, 3), m."""
    sides = [("xyz".index(face[1]), 1.0 if face[0] == "+" else -1.0) for face in c.CUBE_FACE_COLOURS]
    return np.array([sign * np.eye(3)[axis] * shape.size_m[axis] / 2 for axis, sign in sides])


def _object(shape: Shape, enlarged: float, colour: fm.Color) -> dict:
    """Primitives of an object in its own frame, ``enlarged`` times its size."""
    size = _vector(enlarged * np.array(shape.size_m))
    pose = _pose((0.0, 0.0, 0.0))
    if shape.kind is Kind.BOX:
        return {"cubes": [fm.CubePrimitive(pose=pose, size=size, color=colour)]}
    if shape.kind is Kind.SPHERE:
        return {"spheres": [fm.SpherePrimitive(pose=pose, size=size, color=colour)]}
    corners = enlarged * corners_m(shape)
    triangles = [(0, k, k + 1) for k in range(1, 7)] + [(8, 8 + k + 1, 8 + k) for k in range(1, 7)]
    triangles += [side for k in range(8) for side in ((k, (k + 1) % 8, 8 + k), (8 + k, (k + 1) % 8, 8 + (k + 1) % 8))]
    points = [fm.Point3(x=float(x), y=float(y), z=float(z)) for x, y, z in corners]
    indices = [index for triangle in triangles for index in triangle]
    return {"triangles": [fm.TriangleListPrimitive(pose=pose, points=points, color=colour, indices=indices)]}


_IDENTITY = fm.Quaternion(w=1.0, x=0.0, y=0.0, z=0.0)


def _link(finger: str, name: str) -> fm.SceneEntity:
    frame = f"{finger}_{name}"
    if name == "tip":
        sphere = fm.SpherePrimitive(pose=_pose((0.0, 0.0, 0.0)), size=_vector([2 * c.TIP_RADIUS_M] * 3), color=_BLACK)
        return _entity(frame, frame, spheres=[sphere])
    if name == "upper":
        return _entity(frame, frame, cylinders=[_cylinder((0.0, 0.1, 0.0), "y", 0.16, 0.025, _COLOURS[finger])])
    radius = c.MIDDLE_CAPSULE_RADIUS_M if name == "middle" else c.TIP_STEM_RADIUS_M
    x = c.MIDDLE_CAPSULE_X_M if name == "middle" else c.LINKS[3].origin_m[0]
    length = -c.LINKS[2 if name == "middle" else 3].origin_m[2]
    return _entity(frame, frame, cylinders=[_cylinder((x, 0.0, -length / 2), "z", length, radius, _COLOURS[finger])])


def _label(finger: str) -> fm.SceneEntity:
    """A finger's name beside its knee, of the same size from wherever one looks."""
    text = fm.TextPrimitive(
        pose=_pose((0.0, 0.0, 0.0)),
        billboard=True,
        font_size=_LABEL_PX,
        scale_invariant=True,
        color=_COLOURS[finger],
        text=finger.replace("finger", "finger "),
    )
    return _entity(f"{finger}_label", f"{finger}_lower", texts=[text])


@functools.cache
def _arena() -> fm.SceneEntity:
    """The table as a disc and the wall as the boxes of the model."""
    radius = c.WALL_PROFILE_M[-1][0]
    table = fm.CylinderPrimitive(
        pose=_pose((0.0, 0.0, -0.0025)),
        size=_vector([2 * radius, 2 * radius, 0.004]),
        bottom_scale=1.0,
        top_scale=1.0,
        color=fm.Color(r=0.25, g=0.25, b=0.27, a=1.0),
    )
    wall = []
    for geom in sorted(build_scene().geoms, key=_ring_and_segment):
        if geom.name.startswith("wall"):
            w, x, y, z = (float(v) for v in geom.quat)
            pose = fm.Pose(position=_vector(geom.pos), orientation=fm.Quaternion(w=w, x=x, y=y, z=z))
            colour = fm.Color(r=0.85, g=0.85, b=0.88, a=0.15)
            wall.append(fm.CubePrimitive(pose=pose, size=_vector(2 * np.array(geom.size)), color=colour))
    return _entity("arena", WORLD, cylinders=[table], cubes=wall)


def _ring_and_segment(geom: MjsGeom) -> tuple[int, ...]:
    """Of a box of the wall, which is named by both; nothing of other geoms."""
    return tuple(int(number) for number in geom.name.removeprefix("wall").split("_")) if geom.name.startswith("wall") else ()


def _entity(name: str, frame: str, **primitives) -> fm.SceneEntity:
    stamp = fm.Timestamp(sec=0, nsec=0)
    return fm.SceneEntity(timestamp=stamp, frame_id=frame, id=name, frame_locked=True, **primitives)


def _cylinder(centre, axis: str, length_m: float, radius_m: float, colour: fm.Color) -> fm.CylinderPrimitive:
    quarter = float(np.sqrt(0.5))
    orientation = fm.Quaternion(w=quarter, x=quarter, y=0.0, z=0.0) if axis == "y" else _IDENTITY
    return fm.CylinderPrimitive(
        pose=fm.Pose(position=_vector(centre), orientation=orientation),
        size=_vector([2 * radius_m, 2 * radius_m, length_m]),
        bottom_scale=1.0,
        top_scale=1.0,
        color=colour,
    )


def _cube(pose: fm.Pose, width_m: float, colour: fm.Color) -> fm.CubePrimitive:
    return fm.CubePrimitive(pose=pose, size=_vector([width_m] * 3), color=colour)


def _transform(parent: str, child: str, translation, rotation: fm.Quaternion) -> fm.FrameTransform:
    return fm.FrameTransform(
        timestamp=fm.Timestamp(sec=0, nsec=0),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=_vector(translation),
        rotation=rotation,
    )


def _pose(position) -> fm.Pose:
    return fm.Pose(position=_vector(position), orientation=_IDENTITY)


def _vector(values) -> fm.Vector3:
    x, y, z = (float(value) for value in values)
    return fm.Vector3(x=x, y=y, z=z)
