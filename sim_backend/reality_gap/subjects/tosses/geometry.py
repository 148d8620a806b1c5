"""The free body of a model and what it can touch: which geoms, how large, and how far a pose is from contact."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sim_backend.reality_gap.recording import RecordingError


@dataclass(frozen=True)
class ObjectGeometry:
    """A free body and its surroundings, by index into one compiled model.

    Attributes:
        model: nominal, compiled.
        body: name of the free body.
        qpos: index of its joint's first position.
        dof: index of its joint's first velocity.
        geoms: ids of its geoms that collide.
        surroundings: ids of the geoms fixed to the world that collide with them.
        radius_m: of a ball around the body's origin that holds all geoms.
        width_m: twice the least distance from the origin to the surface of the widest geom, or of its box; the unit of errors.
        volume_m3: of the geoms' inertia boxes, an estimate.
    """

    model: mujoco.MjModel
    body: str
    qpos: int
    dof: int
    geoms: tuple[int, ...]
    surroundings: tuple[int, ...]
    radius_m: float
    width_m: float
    volume_m3: float


def geometry_of(model: mujoco.MjModel, body: str) -> ObjectGeometry:
    """The free body of that name.

    Raises:
        RecordingError: if there is no such body, it has no free joint, no geoms, or nothing to touch.
    """
    body_id = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body)
    if body_id < 0:
        names = [model.body(i).name for i in range(1, model.nbody)]
        raise RecordingError(f"the model has no body {body!r}; it has {', '.join(names)}")
    joint = model.body_jntadr[body_id]
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        raise RecordingError(f"body {body!r} has no free joint; add <freejoint/> to it so that it can be tossed")
    geoms = tuple(g for g in range(model.ngeom) if model.body_rootid[model.geom_bodyid[g]] == body_id and _collides(model, g))
    fixed = [g for g in range(model.ngeom) if model.body_weldid[model.geom_bodyid[g]] == 0]
    surroundings = tuple(g for g in fixed if any(_pair_collides(model, g, own) for own in geoms))
    if not geoms or not surroundings:
        raise RecordingError(
            f"body {body!r} cannot touch anything: it needs geoms, and a fixed geom (a table) that collides with them"
        )
    far = [np.linalg.norm(model.geom_pos[g]) + model.geom_rbound[g] for g in geoms]
    volume = float(sum(8.0 * np.prod(model.geom_aabb[g, 3:]) for g in geoms))
    width = 2.0 * max(float(model.geom_aabb[g, 3:].min()) for g in geoms)
    qpos, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    return ObjectGeometry(model, body, qpos, dof, geoms, surroundings, float(max(far)), width, volume)


def gaps_m(model: mujoco.MjModel, geometry: ObjectGeometry, position_m: np.ndarray, quat_wxyz: np.ndarray) -> np.ndarray:
    """Least distance from the object to its surroundings at each pose, negative inside them.

    Args:
        model: the nominal one, or one of the same layout with another size.
        geometry: of the object.
        position_m: shape (n, 3).
        quat_wxyz: shape (n, 4).

    Returns:
        Shape (n,), m; distances beyond ten radii count as ten radii.
    """
    data, far, start = mujoco.MjData(model), 10.0 * geometry.radius_m, geometry.qpos
    out = np.empty(len(position_m))
    for row in range(len(out)):
        data.qpos[start : start + 3], data.qpos[start + 3 : start + 7] = position_m[row], quat_wxyz[row]
        mujoco.mj_kinematics(model, data)
        pairs = ((own, other) for own in geometry.geoms for other in geometry.surroundings)
        out[row] = min(mujoco.mj_geomDistance(model, data, own, other, far, None) for own, other in pairs)
    return out


def _collides(model: mujoco.MjModel, geom: int) -> bool:
    paired = geom in model.pair_geom1 or geom in model.pair_geom2
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom] or paired)


def _pair_collides(model: mujoco.MjModel, one: int, other: int) -> bool:
    types, affinities = model.geom_contype, model.geom_conaffinity
    if types[one] & affinities[other] or types[other] & affinities[one]:
        return True
    pairs = zip(model.pair_geom1, model.pair_geom2, strict=True)
    return any({int(a), int(b)} == {one, other} for a, b in pairs)
