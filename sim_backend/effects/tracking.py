"""Effects between the cube and what the tracker reports of it; each acts on n robots in every camera frame.

All functions are pure and compiled, and go through the robots one by one, so that a robot in a batch gets the same bits as a
robot alone. Where a robot's parameters are absent its numbers pass untouched.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np

from sim_backend.effects.effect import Acts, Effect, Group, Parameter, Scope, per_axis, per_robot
from sim_backend.effects.pose_errors import jumped_quat, noisy_pose, offset_pose, scaled_position_m
from sim_backend.trifinger import constants as c

NOMINAL_RATE_HZ = 1.0 / c.CAMERA_PERIOD_S


def frame_period_s(rate_hz: np.ndarray) -> np.ndarray:
    """Time between two images, shape (n,), s."""
    return 1.0 / rate_hz


@numba.njit
def later_s(delay_s: float, extra_s: np.ndarray) -> np.ndarray:
    """Delays from image to report, shape (n,), that are longer than ``delay_s`` by a constant (n,), s."""
    out = np.empty(len(extra_s))
    for i in range(len(extra_s)):
        out[i] = delay_s + extra_s[i]
    return out


@numba.njit
def jittered_s(delay_s: np.ndarray, std_s: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Delays (n,) that differ from frame to frame but never go back in time, s; ``normal`` (n, 1) is standard normal."""
    out = np.empty(len(delay_s))
    for i in range(len(delay_s)):
        out[i] = max(delay_s[i] + std_s[i] * normal[i, 0], 0.0)
    return out


@numba.njit
def gap_frames(duration_frames: float) -> int:
    """Length of a gap in whole frames: the nearest number, and at least one."""
    return max(int(np.rint(duration_frames)), 1)


@numba.njit
def dropped(probability: np.ndarray, duration_frames: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """Frames that never arrive.

    Args:
        probability: that a gap begins with a frame, shape (n,).
        duration_frames: length of a gap in frames, shape (n,); see :func:`gap_frames` for parts of a frame.
        uniform: numbers in (0, 1) of this frame and those before it, newest first, shape (n, k).

    Returns:
        Shape (n,), whether this frame falls into a gap.
    """
    lost = np.zeros(len(probability), dtype=np.bool_)
    for i in range(len(probability)):
        for k in range(min(gap_frames(duration_frames[i]), uniform.shape[1])):
            lost[i] |= uniform[i, k] < probability[i]
    return lost


@numba.njit
def missed_share(missed: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """Share of the coloured pixels that are not recognised in a frame, shape (n,).

    Beta(1, (1 - m) / m) with mean m = ``missed`` (n,), up to 0.5: close to an exponential where m is small, but a share whatever
    m is. ``uniform`` (n, 1) are numbers in (0, 1).
    """
    out = np.empty(len(missed))
    for i in range(len(missed)):
        out[i] = -math.expm1(missed[i] / (1.0 - missed[i]) * math.log(uniform[i, 0]))
    return out


@numba.njit
def occluder_radius_m(radius_m: float, strength: float) -> float:
    """Radius that a part of a finger hides the cube with, m; nothing is hidden at strength 0."""
    return radius_m * strength


@numba.njit
def foreign_sphere(radius_m: np.ndarray, position_m: np.ndarray) -> np.ndarray:
    """Spheres in the way, shape (n, 4): centre in the world frame and radius (n,), m."""
    out = np.empty((len(radius_m), 4))
    for i in range(len(radius_m)):
        for axis in range(3):
            out[i, axis] = position_m[i, axis]
        out[i, 3] = radius_m[i]
    return out


@numba.njit
def working(dead: np.ndarray) -> np.ndarray:
    """Cameras that give images, shape (n, 3)."""
    return dead < 0.5


def _noise(position_about: str, rotation_about: str) -> tuple[Parameter, ...]:
    return (
        per_robot("position_m", "m", 0.0, 0.05, 0.0, position_about),
        per_robot("rotation_rad", "rad", 0.0, 0.5, 0.0, rotation_about),
    )


def _effect(
    name: str,
    about: str,
    source: str,
    apply: Callable[..., Any],
    *parameters: Parameter,
    shape: Sequence[Parameter] = (),
    group: Group = Group.TRACKING,
) -> Effect:
    return Effect(name, group, about, source, Acts.TRACKER, parameters, apply, tuple(shape))


_TOT = "trifinger_object_tracking @78ec981"
_CALIBRATION = "trifinger_simulation data/camera_params: extrinsic standard deviations of 0.3 to 0.6 mm and 1 to 3 mrad"
_SELF_TEST = "robot_fingers trifingerpro_post_submission.py allows 20 mm and 0.2 rad on a resting cube"

EFFECTS = (
    _effect(
        "tracking_rate",
        "images are taken more or less often",
        f"{_TOT} tricamera_object_tracking_driver.hpp: 10 Hz by default, configurable",
        frame_period_s,
        per_robot("rate_hz", "Hz", 1.0, 100.0, NOMINAL_RATE_HZ, "of the images"),
    ),
    _effect(
        "tracking_latency",
        "reports arrive later than the nominal 90 ms after their image",
        "trifinger_simulation trifinger_platform.py, from real data; trifinger_rl_datasets sim_env.py has delays up to 0.3 s",
        later_s,
        per_robot("extra_s", "s", -0.08, 0.3, 0.0, "added to 90 ms"),
    ),
    _effect(
        "tracking_jitter",
        "the time from image to report differs from frame to frame",
        f"{_TOT} pose_detector.cpp: an optimisation of random length for each frame",
        jittered_s,
        per_robot("std_s", "s", 0.0, 0.1, 0.0, "standard deviation of the delay"),
    ),
    _effect(
        "tracking_dropout",
        "frames are lost and the last report stands",
        "marker freezing in Dactyl (arXiv 1808.00177)",
        dropped,
        per_robot("probability", "", 0.0, 1.0, 0.0, "that a gap begins with a frame"),
        shape=(per_robot("duration_s", "s", 0.0, 3.0, 0.1, "length of a gap, at least one frame"),),
    ),
    _effect(
        "tracking_scale",
        "distances are seen too large or too small",
        f"{_TOT} cube_model.hpp takes the cube for 65.2 mm wide, it has 65 mm",
        scaled_position_m,
        per_robot("factor_error", "", -0.1, 0.1, 0.0, "of distances from the world's origin"),
    ),
    _effect(
        "tracking_offset",
        "the cameras stand askew to where their calibration says",
        _CALIBRATION,
        offset_pose,
        per_axis("position_m", "m", -0.05, 0.05, 0.0, "reported minus true position"),
        per_axis("rotation_rad", "rad", -0.2, 0.2, 0.0, "rotation vector about the world's origin"),
    ),
    _effect(
        "tracking_noise",
        "every frame has an error of its own",
        f"{_TOT} a1_introduction.rst: no information from previous frames is used; {_SELF_TEST}",
        noisy_pose,
        *_noise("standard deviation of each coordinate", "standard deviation of each component of the rotation vector"),
    ),
    _effect(
        "tracking_episode_noise",
        "poses have an error that stays the same within a trial",
        "correlated observation noise of Dactyl (arXiv 1808.00177)",
        noisy_pose,
        *_noise("standard deviation over trials", "standard deviation over trials"),
    ),
    _effect(
        "observation_noise",
        "every reading of a pose has an error of its own, even of the same frame",
        "observation noise of Dactyl (arXiv 1808.00177) and of IsaacGymEnvs Trifinger.yaml",
        noisy_pose,
        *_noise("standard deviation of each coordinate", "standard deviation of each component of the rotation vector"),
    ),
    _effect(
        "orientation_jumps",
        "faces are taken for each other, so that the orientation jumps to another of the cube's 24",
        f"{_TOT} a1_introduction.rst: each frame is matched on its own by the colours of the faces; no rate is published",
        jumped_quat,
        per_robot("probability", "", 0.0, 1.0, 0.0, "per frame in which all faces are seen"),
        shape=(per_robot("growth", "", 1.0, 100.0, 4.0, "factor for each face that is hidden from all cameras"),),
    ),
    _effect(
        "colour_segmentation",
        "part of the faces' pixels is not recognised, by another share in each frame",
        f"{_TOT}: pixels are classified by colour; light and wear differ",
        missed_share,
        per_robot("missed", "", 0.0, 0.5, 0.0, "mean share of the pixels"),
    ),
    _effect(
        "occlusion_by_fingers",
        "fingers hide parts of the cube from the cameras",
        f"{_TOT} pose_detector.cpp: confidence falls with the pixels that are seen",
        occluder_radius_m,
        per_robot("strength", "", 0.0, 2.0, 0.0, "thickness of the fingers; 1 is that of the model"),
    ),
    _effect(
        "foreign_occlusion",
        "an opaque ball hangs between cube and cameras",
        "reason: cables and hands get in the way",
        foreign_sphere,
        per_robot("radius_m", "m", 0.0, 0.15, 0.0, "of the ball"),
        shape=(per_axis("position_m", "m", -0.5, 0.5, 0.15, "of its centre"),),
    ),
    _effect(
        "dead_camera",
        "a camera gives no images",
        f"{_TOT} pose_detector.cpp counts the cameras that see the object",
        working,
        Parameter("dead", "", 0.0, 1.0, 0.0, Scope.CAMERA, "1 if it is dead"),
        group=Group.FAULT,
    ),
)
