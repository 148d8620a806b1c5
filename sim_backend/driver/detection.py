"""One camera frame: from the true pose of the object to what the detector makes of the three images, with its confidence.

The detector works on each frame alone (TOT doc/a1_introduction.rst), so that this is a function of the frame; what lasts from
frame to frame is the tracker's (``tracker.py``). Numbers by chance come from (noise seed, frame number, channel): a robot in a
batch gets the same ones as a robot alone.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numba
import numpy as np

from sim_backend.driver.compilation import compiled_once
from sim_backend.driver.visibility import look
from sim_backend.effects import noise, pose_errors, tracking
from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c

SEEN_SHARE = 0.1
"""A camera sees a face from this share of it on; the detector drops colours with few pixels (TOT color_segmenter.cpp)."""

WHITE, EPISODE, JUMP, MISSED, JITTER, DROPOUT, READING = 100, 106, 112, 114, 115, 116, 120
"""First channels of ``noise``, which has 100 to 199 for the tracker."""


Pose = tuple[np.ndarray, np.ndarray]
"""Positions, shape (n, 3), m, and orientations, shape (n, 4) wxyz."""
Detected = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""What :func:`detect` returns."""


class Values(NamedTuple):
    """Parameters of the tracking effects that n robots have, as the catalogue names them, and half the object's widths."""

    extra_s: np.ndarray
    jitter_s: np.ndarray
    dropout_probability: np.ndarray
    dropout_frames: np.ndarray
    scale_error: np.ndarray
    offset_m: np.ndarray
    offset_rad: np.ndarray
    noise_m: np.ndarray
    noise_rad: np.ndarray
    episode_noise_m: np.ndarray
    episode_noise_rad: np.ndarray
    reading_noise_m: np.ndarray
    reading_noise_rad: np.ndarray
    jump_probability: np.ndarray
    jump_growth: np.ndarray
    missed: np.ndarray
    finger_thickness: np.ndarray
    sphere_radius_m: np.ndarray
    sphere_position_m: np.ndarray
    dead: np.ndarray
    half_size_m: np.ndarray

    def rows(self, index: np.ndarray) -> "Values":
        """Those of some of the robots."""
        return Values(*(values[index] for values in self))


def values_of(physics: Physics, size_m: tuple[float, float, float]) -> Values:
    """The values of n robots, for an object with these extents along its axes, m."""
    v = physics.value
    period_s = tracking.frame_period_s(v("tracking_rate.rate_hz"))
    return Values(
        extra_s=v("tracking_latency.extra_s"),
        jitter_s=v("tracking_jitter.std_s"),
        dropout_probability=v("tracking_dropout.probability"),
        dropout_frames=v("tracking_dropout.duration_s") / period_s,
        scale_error=v("tracking_scale.factor_error"),
        offset_m=v("tracking_offset.position_m"),
        offset_rad=v("tracking_offset.rotation_rad"),
        noise_m=v("tracking_noise.position_m"),
        noise_rad=v("tracking_noise.rotation_rad"),
        episode_noise_m=v("tracking_episode_noise.position_m"),
        episode_noise_rad=v("tracking_episode_noise.rotation_rad"),
        reading_noise_m=v("observation_noise.position_m"),
        reading_noise_rad=v("observation_noise.rotation_rad"),
        jump_probability=v("orientation_jumps.probability"),
        jump_growth=v("orientation_jumps.growth"),
        missed=v("colour_segmentation.missed"),
        finger_thickness=v("occlusion_by_fingers.strength"),
        sphere_radius_m=v("foreign_occlusion.radius_m"),
        sphere_position_m=v("foreign_occlusion.position_m"),
        dead=v("dead_camera.dead"),
        half_size_m=0.5 * np.array(size_m) * v("cube_size.factor")[:, None],
    )


@numba.njit
def confidence_of(size: np.ndarray, seen: np.ndarray, sharp: np.ndarray, missed: np.ndarray) -> np.ndarray:
    """Confidence of the detector, shape (n,): 0.4 good_pixel_ratio + 0.3 filled_face_ratio + 0.3 cameras_with_pixels / 3.

    The formula is the real one's (TOT pose_detector.cpp); what its terms are out of is our reading of their names, with sample
    points for pixels:

    - good_pixel_ratio: of all pixels that the object should fill in the three images, those that are seen and not beside the
      outline of what is in the way, where colours mix; faces count by their size in the images;
    - filled_face_ratio: mean share that is seen, over the faces that look at a camera;
    - cameras_with_pixels: cameras that see at least one face.

    Faces before a dead camera count as not seen. Pixels that the segmentation misses count neither as good nor as filling.
    Without any face there is no pose: 0.

    Args:
        size: of each face in each image, shape (n, 3, 6), rad^2.
        seen: share of it that is seen, shape (n, 3, 6).
        sharp: share of it that is seen away from outlines, shape (n, 3, 6).
        missed: share of the pixels that are not recognised in this frame, shape (n,).
    """
    out = np.zeros(len(size))
    for i in range(len(size)):
        faces, filled, pixels, good, cameras = 0, 0.0, 0.0, 0.0, 0
        for camera in range(3):
            sees = False
            for face in range(6):
                faces += size[i, camera, face] > 0.0
                filled += seen[i, camera, face]
                pixels += size[i, camera, face]
                good += size[i, camera, face] * sharp[i, camera, face]
                sees |= seen[i, camera, face] * (1.0 - missed[i]) >= SEEN_SHARE
            cameras += sees
        if cameras > 0:
            out[i] = (0.4 * good / pixels + 0.3 * filled / faces) * (1.0 - missed[i]) + 0.3 * cameras / 3
    return out


@numba.njit
def hidden_faces(size: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """How many faces no camera sees though they look at one, in parts of faces, shape (n,); arguments (n, 3, 6)."""
    out = np.zeros(len(size))
    for i in range(len(size)):
        for face in range(6):
            looks, best = False, 0.0
            for camera in range(3):
                looks |= size[i, camera, face] > 0.0
                best = max(best, seen[i, camera, face])
            if looks:
                out[i] += 1.0 - best
    return out


@numba.njit
def _normal(seed: np.ndarray, frame: np.ndarray, first_channel: int, count: int) -> np.ndarray:
    """Standard normal numbers, shape (n, count); ``frame`` (n,)."""
    out = np.empty((len(seed), count))
    for i in range(len(seed)):
        for k in range(count):
            out[i, k] = noise.gaussian(seed[i], frame[i], first_channel + k)
    return out


@numba.njit
def _uniform(seed: np.ndarray, frame: np.ndarray, channel: int, count: int, frame_step: int, channel_step: int) -> np.ndarray:
    """Numbers in (0, 1), shape (n, count), whose frame and channel change by these steps from one to the next."""
    out = np.empty((len(seed), count))
    for i in range(len(seed)):
        for k in range(count):
            out[i, k] = noise.uniform(seed[i], frame[i] + k * frame_step, channel + k * channel_step)
    return out


@numba.njit
def _certain(v: Values, works: np.ndarray, confidence: np.ndarray, hidden: np.ndarray) -> None:
    """Set confidence (n,) and hidden faces (n,) of robots for which no effect makes them uncertain."""
    for i in range(len(confidence)):
        if v.finger_thickness[i] == 0.0 and v.sphere_radius_m[i] == 0.0 and works[i, 0] and works[i, 1] and works[i, 2]:
            hidden[i] = 0.0
            if v.missed[i] == 0.0:
                confidence[i] = 1.0


@numba.njit
def _meaningless(confidence: np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray) -> None:
    """Put poses that there was nothing to go by for, (n, 3) and (n, 4), at the origin."""
    for i in range(len(confidence)):
        if confidence[i] == 0.0:
            for k in range(3):
                position_m[i, k], quat_wxyz[i, 1 + k] = 0.0, 0.0
            quat_wxyz[i, 0] = 1.0


def _detect(
    v: Values, seed: np.ndarray, frame: np.ndarray, joint_position_rad: np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray
) -> Detected:
    works, sphere = tracking.working(v.dead), tracking.foreign_sphere(v.sphere_radius_m, v.sphere_position_m)
    size, seen, sharp = look(joint_position_rad, position_m, quat_wxyz, v.half_size_m, v.finger_thickness, sphere, works)
    missed = tracking.missed_share(v.missed, _uniform(seed, frame, MISSED, 1, 0, 0))
    confidence, hidden = confidence_of(size, seen, sharp, missed), hidden_faces(size, seen)
    _certain(v, works, confidence, hidden)
    chance = pose_errors.jump_probability(v.jump_probability, v.jump_growth, hidden)
    found_wxyz = pose_errors.jumped_quat(quat_wxyz, chance, _uniform(seed, frame, JUMP, 2, 0, 1))
    white, lasting = _normal(seed, frame, WHITE, 6), _normal(seed, np.zeros_like(frame), EPISODE, 6)
    found_m, found_wxyz = pose_errors.noisy_pose(position_m, found_wxyz, v.noise_m, v.noise_rad, white)
    found_m, found_wxyz = pose_errors.noisy_pose(found_m, found_wxyz, v.episode_noise_m, v.episode_noise_rad, lasting)
    found_m = pose_errors.scaled_position_m(found_m, v.scale_error)
    found_m, found_wxyz = pose_errors.offset_pose(found_m, found_wxyz, v.offset_m, v.offset_rad)
    _meaningless(confidence, found_m, found_wxyz)
    delay_s = tracking.jittered_s(tracking.later_s(c.CAMERA_DELAY_S, v.extra_s), v.jitter_s, _normal(seed, frame, JITTER, 1))
    gap = 1 if v.dropout_probability.max() == 0.0 else tracking.gap_frames(v.dropout_frames.max())
    lost = tracking.dropped(v.dropout_probability, v.dropout_frames, _uniform(seed, frame, DROPOUT, gap, -1, 0))
    return seen >= SEEN_SHARE, confidence, found_m, found_wxyz, delay_s, lost


def _read(v: Values, seed: np.ndarray, step: np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray) -> Pose:
    normal = _normal(seed, step, READING, 6)
    return pose_errors.noisy_pose(position_m, quat_wxyz, v.reading_noise_m, v.reading_noise_rad, normal)


@functools.cache
def _compiled() -> tuple[Callable[..., Detected], Callable[..., Pose]]:
    """Both functions, compiled once a process by calling them for a nominal robot."""

    def compile_both(cache: bool) -> tuple[Callable[..., Detected], Callable[..., Pose]]:
        v = values_of(Physics.nominal(1), (0.1, 0.1, 0.1))
        seed, frame = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
        pose = np.ones((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])
        detect, read = numba.njit(cache=cache)(_detect), numba.njit(cache=cache)(_read)
        detect(v, seed, frame, np.zeros((1, 9)), *pose)
        read(v, seed, frame, *pose)
        return detect, read

    return compiled_once(compile_both)


def detect(
    values: Values,
    seed: np.ndarray,
    frame: np.ndarray,
    joint_position_rad: np.ndarray,
    position_m: np.ndarray,
    quat_wxyz: np.ndarray,
) -> Detected:
    """What n robots' detectors find in one frame.

    Args:
        values: of the n robots.
        seed: noise seeds, int64, shape (n,).
        frame: number of the frame for each robot, int64, shape (n,).
        joint_position_rad: true, shape (n, 9).
        position_m: true, shape (n, 3).
        quat_wxyz: true, shape (n, 4).

    Returns:
        Visible faces (n, 3 cameras, 6 faces); confidence (n,); position (n, 3), m, and orientation (n, 4) wxyz, at the origin
        where the confidence is 0; delay until the report (n,), s; and whether the frame is lost (n,).
    """
    # Copies: for arrays that may not be written to all of it would be compiled once more.
    arrays = (np.array(array, order="C") for array in (joint_position_rad, position_m, quat_wxyz))
    return _compiled()[0](values, seed, frame, *arrays)


class Detector(Protocol):
    """What finds the objects of n robots in a frame: :func:`detect`, the formula, or something that looks at images."""

    def __call__(
        self,
        values: Values,
        seed: np.ndarray,
        frame: np.ndarray,
        joint_position_rad: np.ndarray,
        position_m: np.ndarray,
        quat_wxyz: np.ndarray,
    ) -> Detected:
        """As :func:`detect`."""
        ...


def read(values: Values, seed: np.ndarray, step: int | np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray) -> Pose:
    """Poses (n, 3) and (n, 4) as they are read at a physics step (of each, or of all), with the noise of the reading."""
    return _compiled()[1](values, seed, np.full(len(seed), step), position_m, quat_wxyz)
