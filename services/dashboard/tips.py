"""Where fingertips and the object were, from the transforms, the scene and the tracker's reports of a log."""

from typing import Any

import numpy as np

from api_schemas.tolerance import POSITION_TOLERANCE_M
from trial_logs.moments import Moment, Seen, holds_of_fingers, turns, way_of_object

OBJECT = "cube_tracked"
TIP = "_tip"
WORLD = "world"
LONGEST_CHAIN = 10


def moments_of(header: dict[str, Any], arrays: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """The moments of a reduced log by time, as its header holds them; those that its robot told of come along."""
    t_s, pose = arrays["tracked_t_s"], arrays["tracked_pose"]
    goal_m = np.array(header["goal"][0][:3]) if header["goal"] else None
    found = [Moment(event["t_s"], event["text"], "now") for event in header["events"] if event["t_s"] > 0]
    found += way_of_object(t_s, pose, goal_m, POSITION_TOLERANCE_M)
    seen = _seen(header, arrays)
    found += [] if seen is None else holds_of_fingers(seen)
    return [vars(moment) for moment in sorted(found, key=lambda each: each.t_s)]


def _seen(header: dict[str, Any], arrays: dict[str, np.ndarray]) -> Seen | None:
    """Object and fingertips at the times at which the object was seen; None where the log does not have them."""
    thing = [each for each in header["entities"] if each["id"] == OBJECT]
    tips = [each for each in header["entities"] if each["id"].endswith(TIP) and each["kind"] == "spheres"]
    at_s, frames_s = arrays["captured_t_s"], arrays["frame_t_s"]
    if not thing or not tips or not len(frames_s) or len(at_s) != len(arrays["tracked_pose"]):
        return None
    paths = [_path(tip["frame"], header, arrays) for tip in tips]
    if any(path is None for path in paths):
        return None
    moved = np.stack([_at(at_s, frames_s, path) for path in paths if path is not None], axis=1)
    half_m, is_ball = _extent(thing[0])
    names = [f"finger {tip['id'].removesuffix(TIP).removeprefix('finger')}" for tip in tips]
    return Seen(arrays["tracked_t_s"], arrays["tracked_pose"], moved, half_m, is_ball, tips[0]["size"][0] / 2, names)


def _path(frame: str, header: dict[str, Any], arrays: dict[str, np.ndarray]) -> np.ndarray | None:
    """Positions of a frame's origin in the world, shape (frames, 3); None where its chain does not lead there."""
    fixed = {each["child"]: (each["parent"], np.array(each["pose"])[None]) for each in header["fixed"]}
    moving = {child: (parent, arrays["frame_pose"][:, at]) for at, (parent, child) in enumerate(header["frames"])}
    links, point_m = fixed | moving, np.zeros((len(arrays["frame_t_s"]), 3))
    for _ in range(LONGEST_CHAIN):
        if frame == WORLD:
            return point_m
        if frame not in links:
            return None
        frame, pose = links[frame]
        point_m = np.einsum("nij,nj->ni", np.broadcast_to(turns(pose[:, 3:]), (len(point_m), 3, 3)), point_m) + pose[:, :3]
    return None


def _at(wanted_s: np.ndarray, t_s: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(wanted_s, t_s, points_m[:, axis]) for axis in range(3)], axis=1)


def _extent(thing: dict[str, Any]) -> tuple[np.ndarray, bool]:
    """Half the extent of an object along its axes, and whether it is a ball."""
    if thing["kind"] == "triangles":
        return np.abs(np.array(thing["points"])).max(axis=0), False
    return np.array(thing["size"]) / 2, thing["kind"] == "spheres"
