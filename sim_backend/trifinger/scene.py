"""The TriFinger Pro in its arena with the cube, built as a MuJoCo specification from the cited constants.

The numbers have one home (``constants.py``), so the MJCF is generated, not written by hand; ``build_scene().to_xml()`` is
what a log carries. Links are primitive geoms: spheres for the tips, capsules for the links.
"""

import numpy as np
from mujoco import MjModel, MjsBody, MjSpec, mjtCone, mjtDisableBit, mjtGeom, mjtIntegrator

from sim_backend.trifinger import constants as c
from sim_backend.trifinger.object_body import add_object
from sim_backend.trifinger.objects import CUBE, Shape

ARENA_BITS, CUBE_BITS, FINGER_BITS, MIDDLE_BITS = 1, 2, 4, 8
"""What may touch what: the middle links reach neither table nor wall, so that no step looks whether they do."""
WALL_PARTS = 8
"""Bodies that the wall's boxes are shared among, so that the broad phase leaves out those where nothing is near."""
VISUAL_GROUP = 2


def build_scene(*, physics_step_s: float = c.PHYSICS_STEP_S, shape: Shape = CUBE) -> MjSpec:
    """Specification of the robot, arena and cube.

    Args:
        physics_step_s: integration step, s.
        shape: the object in the arena; its body and geom are named "cube" whatever it is.

    Returns:
        A specification with joints and actuators in the order of ``constants.JOINT_NAMES`` and the cube's free joint last:
        qpos is joint position (9), cube position (3) and cube quaternion wxyz (4).
    """
    spec = MjSpec()
    spec.modelname = "trifinger_pro"
    spec.compiler.degree = False
    spec.option.timestep = physics_step_s
    spec.option.integrator = mjtIntegrator.mjINT_EULER
    spec.option.cone = mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.disableflags |= mjtDisableBit.mjDSBL_ISLAND  # one robot and one object: what joins them costs more than it saves
    spec.option.gravity = [0.0, 0.0, -c.GRAVITY_M_S2]
    _add_arena(spec)
    for finger, yaw_rad in zip(c.FINGER_NAMES, c.FINGER_YAW_RAD, strict=True):
        _add_finger(spec, finger, float(yaw_rad))
    add_object(spec, shape, contact=_contact(CUBE_BITS, ARENA_BITS | FINGER_BITS | MIDDLE_BITS), visual=_visual())
    _add_finger_cube_pairs(spec)
    _add_cameras(spec)
    return spec


def discard_what_shows(spec: MjSpec) -> MjSpec:
    """The specification itself, without what only shows: in every step it would be moved along."""
    spec.compiler.discardvisual = True
    for unseen in (*spec.cameras, *spec.lights):
        spec.delete(unseen)
    return spec


def compile_scene(*, physics_step_s: float = c.PHYSICS_STEP_S, shape: Shape = CUBE) -> MjModel:
    """The compiled model of :func:`build_scene`."""
    return build_scene(physics_step_s=physics_step_s, shape=shape).compile()


def _add_arena(spec: MjSpec) -> None:
    spec.worldbody.add_light(pos=[0.0, 0.0, 1.5], dir=[0.0, 0.0, -1.0])
    spec.worldbody.add_geom(
        name="table",
        type=mjtGeom.mjGEOM_PLANE,  # only its top within the wall can be reached
        size=[c.TABLE_HALF_EXTENT_M[0], c.TABLE_HALF_EXTENT_M[1], 0.05],
        rgba=[0.25, 0.25, 0.27, 1.0],
        **_contact(ARENA_BITS, CUBE_BITS | FINGER_BITS),
    )
    parts = [spec.worldbody.add_body(name=f"wall_part_{part}") for part in range(WALL_PARTS)]
    for ring, (bottom, top) in enumerate(zip(c.WALL_PROFILE_M[:-1], c.WALL_PROFILE_M[1:], strict=True)):
        _add_wall_ring(parts, ring, bottom, top)


def _add_wall_ring(parts: list[MjsBody], ring: int, bottom: tuple[float, float], top: tuple[float, float]) -> None:
    """Boxes whose inner faces form a ring (or cone) from (radius, height) ``bottom`` to ``top``."""
    rise, widening = top[1] - bottom[1], top[0] - bottom[0]
    tilt_rad = float(np.arctan2(widening, rise))
    half_length = float(np.hypot(rise, widening)) / 2
    half_width = max(bottom[0], top[0]) * float(np.tan(np.pi / c.WALL_SEGMENTS))
    half_thickness = c.WALL_THICKNESS_M / 2
    radius = (bottom[0] + top[0]) / 2 + half_thickness * np.cos(tilt_rad)
    height = (bottom[1] + top[1]) / 2 - half_thickness * np.sin(tilt_rad)
    for segment in range(c.WALL_SEGMENTS):
        angle = 2 * np.pi * segment / c.WALL_SEGMENTS
        parts[segment * len(parts) // c.WALL_SEGMENTS].add_geom(
            name=f"wall{ring}_{segment}",
            type=mjtGeom.mjGEOM_BOX,
            pos=[radius * np.cos(angle), radius * np.sin(angle), height],
            quat=_product(_about([0, 0, 1], angle), _about([0, 1, 0], tilt_rad)),
            size=[half_thickness, half_width, half_length],
            mass=0.0,
            rgba=[0.85, 0.85, 0.88, 0.25],
            **_contact(ARENA_BITS, CUBE_BITS | FINGER_BITS),
        )


def _add_finger(spec: MjSpec, finger: str, yaw_rad: float) -> None:
    parent, quat = spec.worldbody, _about([0, 0, 1], yaw_rad)
    for index, link in enumerate(c.LINKS):
        pos = link.origin_m if index else (0.0, 0.0, c.FINGER_BASE_HEIGHT_M)
        body = parent.add_body(name=f"{finger}_{link.name}", pos=pos, quat=[1.0, 0.0, 0.0, 0.0] if index else quat)
        body.mass, body.ipos, body.fullinertia = link.mass_kg, link.centre_of_mass_m, link.inertia_kg_m2
        body.explicitinertial = True
        if link.joint_axis is not None:
            _add_driven_joint(spec, body, 3 * c.FINGER_NAMES.index(finger) + index, link.joint_axis)
        _add_link_geoms(body, finger, link.name)
        parent = body


def _add_driven_joint(spec: MjSpec, body, joint_index: int, axis: tuple[float, float, float]) -> None:
    name = c.JOINT_NAMES[joint_index]
    body.add_joint(
        name=name,
        axis=axis,
        limited=True,
        range=[c.SOFT_LIMIT_LOWER_RAD[joint_index], c.SOFT_LIMIT_UPPER_RAD[joint_index]],
    )
    actuator = spec.add_actuator(name=name, target=name)
    actuator.trntype = 0  # mjTRN_JOINT
    actuator.set_to_motor()


def _add_link_geoms(body, finger: str, link: str) -> None:
    """Collision geoms; the upper link is out of reach of everything and has a visual one only."""
    grey = [0.35, 0.35, 0.38, 1.0]
    if link == "upper":
        body.add_geom(
            type=mjtGeom.mjGEOM_CAPSULE, fromto=[0.0, 0.02, 0.0, 0.0, 0.18, 0.0], size=[0.025, 0, 0], rgba=grey, **_visual()
        )
    elif link == "middle":
        x = c.MIDDLE_CAPSULE_X_M
        body.add_geom(
            name=f"{finger}_middle",
            type=mjtGeom.mjGEOM_CAPSULE,
            fromto=[x, 0.0, 0.0, x, 0.0, c.LINKS[2].origin_m[2]],
            size=[c.MIDDLE_CAPSULE_RADIUS_M, 0, 0],
            rgba=grey,
            **_contact(MIDDLE_BITS, CUBE_BITS | FINGER_BITS | MIDDLE_BITS),
        )
    elif link == "lower":
        x, _, z = c.LINKS[3].origin_m
        body.add_geom(
            name=f"{finger}_lower",
            type=mjtGeom.mjGEOM_CAPSULE,
            fromto=[x, 0.0, 0.0, x, 0.0, z + c.TIP_RADIUS_M],
            size=[c.TIP_STEM_RADIUS_M, 0, 0],
            rgba=grey,
            **_contact(FINGER_BITS, ARENA_BITS | CUBE_BITS | FINGER_BITS | MIDDLE_BITS),
        )
    else:
        body.add_geom(
            name=f"{finger}_tip",
            type=mjtGeom.mjGEOM_SPHERE,
            size=[c.TIP_RADIUS_M, 0, 0],
            rgba=[0.1, 0.1, 0.1, 1.0],
            **_contact(FINGER_BITS, ARENA_BITS | CUBE_BITS | FINGER_BITS | MIDDLE_BITS),
        )


def _add_finger_cube_pairs(spec: MjSpec) -> None:
    """Contacts of fingers with the cube as explicit pairs, so that their friction is a number of its own."""
    for finger in c.FINGER_NAMES:
        for link in ("tip", "lower", "middle"):
            spec.add_pair(
                name=f"{finger}_{link}_cube",
                geomname1=f"{finger}_{link}",
                geomname2="cube",
                condim=3,
                friction=[c.CUBE_FRICTION, c.CUBE_FRICTION, 0.005, 0.0001, 0.0001],
            )


def _add_cameras(spec: MjSpec) -> None:
    width_px, height_px = c.CAMERA_RESOLUTION_PX
    for camera in c.CAMERAS:
        spec.worldbody.add_camera(
            name=camera.name,
            pos=camera.position_world_m,
            quat=_camera_quat_wxyz(np.array(camera.optical_axis_world)),
            resolution=c.CAMERA_RESOLUTION_PX,
            sensor_size=[width_px * 1e-5, height_px * 1e-5],  # only the ratio of focal length to sensor size matters
            focal_pixel=camera.focal_px,
            principal_pixel=[camera.centre_px[0] - width_px / 2, camera.centre_px[1] - height_px / 2],
        )


def _contact(contype: int, conaffinity: int) -> dict:
    """Contact settings of a collision geom; the cube's friction holds in all of its contacts, whatever it touches."""
    friction = {ARENA_BITS: c.TABLE_FRICTION, CUBE_BITS: c.CUBE_FRICTION}.get(contype, c.FINGER_FRICTION)
    return {
        "contype": contype,
        "conaffinity": conaffinity,
        "condim": 3,
        "friction": [friction, 0.005, 0.0001],
        "priority": 1 if contype == CUBE_BITS else 0,
    }


def _visual() -> dict:
    return {"contype": 0, "conaffinity": 0, "group": VISUAL_GROUP, "mass": 0.0}


def _about(axis, angle_rad: float) -> np.ndarray:
    """Quaternion wxyz of a rotation about a unit axis."""
    return np.concatenate([[np.cos(angle_rad / 2)], np.sin(angle_rad / 2) * np.asarray(axis, dtype=float)])


def _product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Product of two quaternions wxyz."""
    w = p[0] * q[0] - p[1:] @ q[1:]
    return np.concatenate([[w], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])])


def _camera_quat_wxyz(optical_axis: np.ndarray) -> np.ndarray:
    """Orientation of a camera that looks along ``optical_axis`` with world z pointing up in the image."""
    backward = -optical_axis / np.linalg.norm(optical_axis)  # MuJoCo cameras look along their -z
    right = np.cross([0.0, 0.0, 1.0], backward)
    right /= np.linalg.norm(right)
    matrix = np.stack([right, np.cross(backward, right), backward], axis=1)
    w = np.sqrt(max(0.0, 1.0 + np.trace(matrix))) / 2
    if w > 1e-6:
        skew = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
        return np.concatenate([[w], skew / (4 * w)])
    eigenvalues, vectors = np.linalg.eigh(matrix)
    return np.concatenate([[0.0], vectors[:, np.argmax(eigenvalues)]])
