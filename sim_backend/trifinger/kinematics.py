"""Forward kinematics of the three fingers, vectorised over any number of leading axes."""

import numpy as np

from sim_backend.trifinger import constants as c

_AXES = {(1.0, 0.0, 0.0): (1, 2), (0.0, 1.0, 0.0): (2, 0)}


def fingertip_position_world_m(joint_position_rad: np.ndarray) -> np.ndarray:
    """Positions of the centres of the tip spheres.

    Args:
        joint_position_rad: shape (..., 9), order of ``constants.JOINT_NAMES``, rad.

    Returns:
        Shape (..., 9): x, y, z of finger0, finger120 and finger240 in the world frame, m.
    """
    return link_point_world_m(joint_position_rad, 2, c.LINKS[3].origin_m)


def fingertip_velocity_world_m_s(joint_position_rad: np.ndarray, joint_velocity_rad_s: np.ndarray) -> np.ndarray:
    """Velocities of the centres of the tip spheres.

    Args:
        joint_position_rad: shape (..., 9), rad.
        joint_velocity_rad_s: shape (..., 9), rad/s.

    Returns:
        Shape (..., 9): x, y, z of finger0, finger120 and finger240 in the world frame, m/s.
    """
    joints, speeds = (np.asarray(each, dtype=float) for each in (joint_position_rad, joint_velocity_rad_s))
    joints, speeds = (each.reshape(*each.shape[:-1], 3, 3) for each in (joints, speeds))
    point = np.broadcast_to(np.array(c.LINKS[3].origin_m), joints.shape).copy()
    velocity = np.zeros_like(point)
    for index in range(2, -1, -1):
        frame = c.LINKS[index]
        if frame.joint_axis is not None:
            first, second = plane = _AXES[frame.joint_axis]
            point, velocity = (_rotate(each, plane, joints[..., index]) for each in (point, velocity))
            velocity[..., first] -= speeds[..., index] * point[..., second]
            velocity[..., second] += speeds[..., index] * point[..., first]
        point = point + np.array(frame.origin_m)
    yaw = np.broadcast_to(np.array(c.FINGER_YAW_RAD), velocity.shape[:-1])
    velocity = _rotate(velocity, (0, 1), yaw)
    return velocity.reshape(*velocity.shape[:-2], 9)


def elbow_position_world_m(joint_position_rad: np.ndarray) -> np.ndarray:
    """Positions of the upper ends of the lower links, above the tips when a link is upright; shapes as for the tips."""
    return link_point_world_m(joint_position_rad, 2, (c.LINKS[3].origin_m[0], 0.0, 0.0))


def link_point_world_m(joint_position_rad: np.ndarray, link: int, place_m: tuple[float, float, float]) -> np.ndarray:
    """Where a point of a link is, for each finger; shapes as for the tips.

    Args:
        joint_position_rad: shape (..., 9), rad.
        link: index into ``constants.LINKS``; the tip moves with the lower link.
        place_m: the point in the link's own frame, m.
    """
    joints = np.asarray(joint_position_rad, dtype=float)
    joints = joints.reshape(*joints.shape[:-1], 3, 3)
    point = np.broadcast_to(np.array(place_m), joints.shape).copy()
    for index in range(link, -1, -1):
        frame = c.LINKS[index]
        if frame.joint_axis is not None:
            point = _rotate(point, _AXES[frame.joint_axis], joints[..., index])
        point = point + np.array(frame.origin_m)
    yaw = np.array(c.FINGER_YAW_RAD)
    point = _rotate(point, (0, 1), np.broadcast_to(yaw, point.shape[:-1]))
    point[..., 2] += c.FINGER_BASE_HEIGHT_M
    return point.reshape(*point.shape[:-2], 9)


def _rotate(point: np.ndarray, plane: tuple[int, int], angle_rad: np.ndarray) -> np.ndarray:
    """Rotate points within the plane of two axes, from the first towards the second."""
    first, second = plane
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turned = point.copy()
    turned[..., first] = cos * point[..., first] - sin * point[..., second]
    turned[..., second] = sin * point[..., first] + cos * point[..., second]
    return turned


def joint_position_rad(fingertip_position_world_m: np.ndarray) -> np.ndarray:
    """Joint positions that bring the tips to given places, the elbow always on its one side (joint 3 is never positive).

    Args:
        fingertip_position_world_m: shape (..., 9) as from :func:`fingertip_position_world_m`, m.

    Returns:
        Shape (..., 9), rad; NaN for a finger that does not reach so far. Limits of the joints are not regarded.
    """
    point = np.asarray(fingertip_position_world_m, dtype=float)
    point = point.reshape(*point.shape[:-1], 3, 3).copy()
    point[..., 2] -= c.FINGER_BASE_HEIGHT_M
    x, y, z = np.moveaxis(_rotate(point, (0, 1), np.broadcast_to(-np.array(c.FINGER_YAW_RAD), point.shape[:-1])), -1, 0)
    aside = sum(link.origin_m[0] for link in c.LINKS)  # the finger's plane runs beside the axis of its first joint
    length = -c.LINKS[3].origin_m[2]  # of both links
    with np.errstate(invalid="ignore"):
        down = np.sqrt(x * x + z * z - aside * aside)
        along = y - c.LINKS[1].origin_m[1]
        bend = -np.arccos((along * along + down * down) / (2 * length * length) - 1)
    swing = np.arctan2(x, z) - np.arctan2(aside, -down)
    swing = np.arctan2(np.sin(swing), np.cos(swing))
    joints = np.stack([swing, np.arctan2(along, down) - bend / 2, bend], axis=-1)
    joints[np.isnan(joints).any(axis=-1)] = np.nan
    return joints.reshape(*joints.shape[:-2], 9)
