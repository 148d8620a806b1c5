"""The object's body in the scene: its geom, its colours, its mass."""

import numpy as np
from mujoco import MjSpec, mjtGeom

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import ROLLING_FRICTION_M, Kind, Shape, corners_m

_WHITE = [0.9, 0.9, 0.9, 1.0]
_PATCH_THICKNESS_M = 0.0004
_MESH = "octagonal_prism"


def add_object(spec: MjSpec, shape: Shape, *, contact: dict, visual: dict) -> None:
    """Add the free body "cube" with its geom "cube", whatever the object is.

    Args:
        spec: the scene.
        shape: the object.
        contact: contact settings of the geom.
        visual: settings of geoms that only show.
    """
    body = spec.worldbody.add_body(name="cube", pos=[0.0, 0.0, shape.rest_height_m])
    body.mass, body.inertia, body.ipos = shape.mass_kg, shape.inertia_kg_m2, [0.0, 0.0, 0.0]
    body.explicitinertial = True
    body.add_freejoint(name="cube")
    if shape.kind is Kind.SPHERE:
        contact = contact | {"condim": 6, "friction": [*contact["friction"][:2], ROLLING_FRICTION_M]}
    body.add_geom(name="cube", rgba=_WHITE, **_geometry(spec, shape), **contact)
    for face, colour in c.CUBE_FACE_COLOURS.items():
        axis, sign = "xyz".index(face[1]), 1.0 if face[0] == "+" else -1.0
        body.add_geom(name=f"cube_face_{face}", rgba=[*colour, 1.0], **_patch(shape, axis, sign), **visual)


def _geometry(spec: MjSpec, shape: Shape) -> dict:
    half = [length / 2 for length in shape.size_m]
    if shape.kind is Kind.BOX:
        return {"type": mjtGeom.mjGEOM_BOX, "size": half}
    if shape.kind is Kind.SPHERE:
        return {"type": mjtGeom.mjGEOM_SPHERE, "size": [half[0], 0.0, 0.0]}
    spec.add_mesh(name=_MESH, uservert=corners_m(shape).ravel())
    return {"type": mjtGeom.mjGEOM_MESH, "meshname": _MESH}


def _patch(shape: Shape, axis: int, sign: float) -> dict:
    """A coloured patch on the side of the object that looks along an axis; on a sphere, a cap."""
    half, pos = np.array(shape.size_m) / 2, np.zeros(3)
    if shape.kind is Kind.SPHERE:
        pos[axis] = sign * 0.55 * half[0]
        return {"type": mjtGeom.mjGEOM_SPHERE, "size": [0.46 * half[0], 0.0, 0.0], "pos": pos}
    size = half * 0.92
    if shape.kind is Kind.OCTAGONAL_PRISM:
        size[:2] *= np.tan(np.pi / 8) if axis < 2 else np.sqrt(0.5)  # a flat side's width, and a square within the octagon
    size[axis], pos[axis] = _PATCH_THICKNESS_M, sign * half[axis]
    return {"type": mjtGeom.mjGEOM_BOX, "size": size, "pos": pos}
