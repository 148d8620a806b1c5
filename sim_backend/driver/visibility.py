"""Which faces of the object the three cameras see, by casting rays from them to sample points on the faces.

Fingers are the spheres and capsules of ``trifinger/scene.py``; the object is the box of its size (a sphere or prism too), table
and wall hide nothing. Everything is compiled and goes robot by robot: a frame takes some microseconds.
"""

import math

import numba
import numpy as np

from sim_backend.effects.tracking import occluder_radius_m
from sim_backend.trifinger import constants as c

FACES = tuple(c.CUBE_FACE_COLOURS)
"""Order of the faces everywhere: +x, -x, +y, -y, +z, -z."""
SAMPLES = 5
"""Sample points along each edge of a face: cells of 13 mm on the cube, smaller than a fingertip's 20 mm."""
GRAZING_COSINE = 0.1
"""A face seen at less than 6 degrees is a line of 2 pixels in the tracker's images of 270 pixels: it counts as looking away."""
EDGE_M = 0.002
"""Pixels this close to the outline of something in the way are a mixture of both: one pixel at 0.55 m of a 270 px image is
0.55 m / 293 px = 1.9 mm, and the tracker smooths its images before it halves them (TOT). Something thinner than a pixel spoils
no more than its own thickness, so that what has none is not there at all."""

_POSITION_M = np.array([camera.position_world_m for camera in c.CAMERAS])
_CENTRE = np.array([camera.centre_px for camera in c.CAMERAS])
_FOCAL = np.array([camera.focal_px for camera in c.CAMERAS])
_WIDTH_PX, _HEIGHT_PX = c.CAMERA_RESOLUTION_PX


def _image_axes() -> np.ndarray:
    """Axes of the images in the world, shape (3, 3, 3): to the right, down, and forward along the optical axis."""
    forward = np.array([camera.optical_axis_world for camera in c.CAMERAS])
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], axis=1)


_AXES = _image_axes()
_YAW_COS, _YAW_SIN = np.cos(c.FINGER_YAW_RAD), np.sin(c.FINGER_YAW_RAD)
_ORIGIN_M = np.array([link.origin_m for link in c.LINKS])
OCCLUDERS = 10  # three capsules or spheres for each finger, and one foreign sphere


@numba.njit
def _to_world(link: int, x: float, y: float, z: float, q: np.ndarray, finger: int, out: np.ndarray, at: int) -> None:
    """A point of the middle (1) or lower (2) link in the world, from ``out[at]`` on; ``q`` (3,) are the joint positions, rad."""
    if link == 2:
        cos, sin = math.cos(q[2]), math.sin(q[2])
        y, z = cos * y - sin * z, sin * y + cos * z
        x, y, z = x + _ORIGIN_M[2, 0], y + _ORIGIN_M[2, 1], z + _ORIGIN_M[2, 2]
    cos, sin = math.cos(q[1]), math.sin(q[1])
    y, z = cos * y - sin * z, sin * y + cos * z
    x, y, z = x + _ORIGIN_M[1, 0], y + _ORIGIN_M[1, 1], z + _ORIGIN_M[1, 2]
    cos, sin = math.cos(q[0]), math.sin(q[0])
    x, z = cos * x + sin * z, cos * z - sin * x
    out[at] = _YAW_COS[finger] * x - _YAW_SIN[finger] * y
    out[at + 1] = _YAW_SIN[finger] * x + _YAW_COS[finger] * y
    out[at + 2] = z + c.FINGER_BASE_HEIGHT_M


@numba.njit
def finger_capsules(joint_position_rad: np.ndarray, out: np.ndarray) -> None:
    """Capsules of one robot's fingers.

    Args:
        joint_position_rad: shape (9,).
        out: shape (9 or more, 7); filled with both ends of the axis in the world and the radius, m, for the middle link, the
            lower link and the tip of each finger.
    """
    tip_x, tip_z = _ORIGIN_M[3, 0], _ORIGIN_M[3, 2]
    for finger in range(3):
        q = joint_position_rad[3 * finger : 3 * finger + 3]
        middle, lower, tip = out[3 * finger], out[3 * finger + 1], out[3 * finger + 2]
        _to_world(1, c.MIDDLE_CAPSULE_X_M, 0.0, 0.0, q, finger, middle, 0)
        _to_world(1, c.MIDDLE_CAPSULE_X_M, 0.0, _ORIGIN_M[2, 2], q, finger, middle, 3)
        _to_world(2, tip_x, 0.0, 0.0, q, finger, lower, 0)
        _to_world(2, tip_x, 0.0, tip_z + c.TIP_RADIUS_M, q, finger, lower, 3)
        _to_world(2, tip_x, 0.0, tip_z, q, finger, tip, 0)
        _to_world(2, tip_x, 0.0, tip_z, q, finger, tip, 3)
        middle[6], lower[6], tip[6] = c.MIDDLE_CAPSULE_RADIUS_M, c.TIP_STEM_RADIUS_M, c.TIP_RADIUS_M


@numba.njit
def _occluders(joint_position_rad: np.ndarray, thickness: float, sphere: np.ndarray, out: np.ndarray) -> None:
    """Everything that may be in the way of one robot's cameras, shape (``OCCLUDERS``, 7)."""
    finger_capsules(joint_position_rad, out)
    for index in range(OCCLUDERS - 1):
        out[index, 6] = occluder_radius_m(out[index, 6], thickness)
    for axis in range(3):
        out[OCCLUDERS - 1, axis] = out[OCCLUDERS - 1, 3 + axis] = sphere[axis]
    out[OCCLUDERS - 1, 6] = sphere[3]


@numba.njit
def clearance_m(eye: np.ndarray, point: np.ndarray, capsule: np.ndarray) -> float:
    """Distance between the ray from ``eye`` to ``point`` (both (3,)) and the surface of a capsule (7,), negative if it is hit."""
    rx, ry, rz = point[0] - eye[0], point[1] - eye[1], point[2] - eye[2]
    ax, ay, az = capsule[3] - capsule[0], capsule[4] - capsule[1], capsule[5] - capsule[2]
    bx, by, bz = eye[0] - capsule[0], eye[1] - capsule[1], eye[2] - capsule[2]
    rr, aa, ra = rx * rx + ry * ry + rz * rz, ax * ax + ay * ay + az * az, rx * ax + ry * ay + rz * az
    rb, ab = rx * bx + ry * by + rz * bz, ax * bx + ay * by + az * bz
    along_axis, crossing = 0.0, rr * aa - ra * ra
    along_ray = min(max((ra * ab - rb * aa) / crossing, 0.0), 1.0) if crossing > 1e-15 else 0.0
    if aa > 0.0:
        along_axis = min(max((ra * along_ray + ab) / aa, 0.0), 1.0)
    along_ray = min(max((ra * along_axis - rb) / rr, 0.0), 1.0)
    if aa > 0.0:
        along_axis = min(max((ra * along_ray + ab) / aa, 0.0), 1.0)
    x = bx + along_ray * rx - along_axis * ax
    y = by + along_ray * ry - along_axis * ay
    z = bz + along_ray * rz - along_axis * az
    return math.sqrt(x * x + y * y + z * z) - capsule[6]


@numba.njit
def edge_m(capsule: np.ndarray) -> float:
    """Width of the mixture around the outline of a capsule (7,), m; see ``EDGE_M``."""
    return min(EDGE_M, capsule[6])


@numba.njit
def _in_image(camera: int, point: np.ndarray) -> bool:
    """Whether a point is inside a camera's image; the lens' distortion only shifts the margin."""
    x, y, z = 0.0, 0.0, 0.0
    for axis in range(3):
        from_eye = point[axis] - _POSITION_M[camera, axis]
        x += _AXES[camera, 0, axis] * from_eye
        y += _AXES[camera, 1, axis] * from_eye
        z += _AXES[camera, 2, axis] * from_eye
    if z <= 0.0:
        return False
    u, v = _FOCAL[camera, 0] * x / z + _CENTRE[camera, 0], _FOCAL[camera, 1] * y / z + _CENTRE[camera, 1]
    return 0.0 <= u < _WIDTH_PX and 0.0 <= v < _HEIGHT_PX


@numba.njit
def _rotation(quat: np.ndarray, out: np.ndarray) -> None:
    """Rotation matrix (3, 3) of a unit quaternion (4,) wxyz."""
    w, x, y, z = quat
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@numba.njit
def _face_size(eye: np.ndarray, centre: np.ndarray, turn: np.ndarray, half: np.ndarray, face: int) -> float:
    """Size of a face in an image, as the angle it fills (rad^2), or 0 where it looks away."""
    axis, sign = face // 2, 1.0 - 2.0 * (face % 2)
    along, distance_squared = 0.0, 0.0
    for k in range(3):
        to_eye = eye[k] - centre[k] - sign * half[axis] * turn[k, axis]
        along += sign * turn[k, axis] * to_eye
        distance_squared += to_eye * to_eye
    cosine = along / math.sqrt(distance_squared)
    if cosine < GRAZING_COSINE:
        return 0.0
    return cosine * 4.0 * half[(axis + 1) % 3] * half[(axis + 2) % 3] / distance_squared


@numba.njit
def _shares(
    camera: int,
    centre: np.ndarray,
    turn: np.ndarray,
    half: np.ndarray,
    face: int,
    occluders: np.ndarray,
    near: np.ndarray,
    point: np.ndarray,
) -> tuple[float, float]:
    """Shares of a face's sample points that a camera sees, and that it sees sharply."""
    axis, sign = face // 2, 1.0 - 2.0 * (face % 2)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    seen, sharp = 0, 0
    for i in range(SAMPLES):
        for j in range(SAMPLES):
            a = half[first] * ((2 * i + 1) / SAMPLES - 1.0)
            b = half[second] * ((2 * j + 1) / SAMPLES - 1.0)
            for k in range(3):
                point[k] = centre[k] + sign * half[axis] * turn[k, axis] + a * turn[k, first] + b * turn[k, second]
            is_seen = is_sharp = _in_image(camera, point)
            for index in range(OCCLUDERS):
                if is_seen and near[index]:
                    free_m = clearance_m(_POSITION_M[camera], point, occluders[index])
                    is_seen = free_m > 0.0
                    is_sharp = is_sharp and free_m > edge_m(occluders[index])
            seen += is_seen
            sharp += is_seen and is_sharp
    return seen / SAMPLES**2, sharp / SAMPLES**2


@numba.njit
def _near(eye: np.ndarray, centre: np.ndarray, radius: float, occluders: np.ndarray, near: np.ndarray) -> None:
    """Which occluders can hide anything within ``radius`` of ``centre`` at all."""
    for index in range(OCCLUDERS):
        near[index] = occluders[index, 6] > 0.0 and clearance_m(eye, centre, occluders[index]) < radius + EDGE_M


@numba.njit
def look(
    joint_position_rad: np.ndarray,
    position_m: np.ndarray,
    quat_wxyz: np.ndarray,
    half_m: np.ndarray,
    thickness: np.ndarray,
    sphere: np.ndarray,
    works: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the cameras see of the object.

    Args:
        joint_position_rad: true joint positions, shape (n, 9).
        position_m: of the object in the world, shape (n, 3).
        quat_wxyz: shape (n, 4).
        half_m: half widths of the object along its axes, shape (n, 3).
        thickness: factor on the radii of the fingers, shape (n,); 0 for fingers that hide nothing.
        sphere: centre in the world and radius of an opaque sphere, shape (n, 4), m; radius 0 for none.
        works: whether a camera gives images, shape (n, 3).

    Returns:
        Three arrays of shape (n, 3 cameras, 6 faces): the size of each face in the image (rad^2, 0 where it looks away), the
        share of it that is seen, and the share that is seen sharply, away from the outline of what is in the way.
    """
    n = len(position_m)
    size, seen, sharp = np.zeros((n, 3, 6)), np.zeros((n, 3, 6)), np.zeros((n, 3, 6))
    occluders, near = np.zeros((OCCLUDERS, 7)), np.zeros(OCCLUDERS, dtype=np.bool_)
    turn, point = np.empty((3, 3)), np.empty(3)
    for i in range(n):
        _occluders(joint_position_rad[i], thickness[i], sphere[i], occluders)
        _rotation(quat_wxyz[i], turn)
        radius = math.sqrt(half_m[i, 0] ** 2 + half_m[i, 1] ** 2 + half_m[i, 2] ** 2)
        for camera in range(3):
            _near(_POSITION_M[camera], position_m[i], radius, occluders, near)
            for face in range(6):
                size[i, camera, face] = _face_size(_POSITION_M[camera], position_m[i], turn, half_m[i], face)
                if size[i, camera, face] > 0.0 and works[i, camera]:
                    seen[i, camera, face], sharp[i, camera, face] = _shares(
                        camera, position_m[i], turn, half_m[i], face, occluders, near, point
                    )
    return size, seen, sharp
