"""What a log says about its tracker alone: how late, how regular, how noisy, what it loses and what it mistakes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.reality_gap.quantiles import MEDIAN_SIZE
from sim_backend.reality_gap.recording import ObjectSignals, Recording
from sim_backend.reality_gap.subjects.cube.windows import rotation_matrices, usable_frames

JUMP_RAD = 0.6
"""A turn by more than this that is gone in another frame is a jump: the cube's own turns onto itself are of a quarter or more."""
_STILL_M = 0.004
_STILL_FRAMES = 9  # a cube is at rest in a frame if it has been seen at one place in so many frames about it
_LEVEL = 0.995  # cosine between an axis of a cube on a face and the vertical, as seen
_LEAST_FRAMES = 20
_SHORTEST_S = 1e-4


@dataclass(frozen=True)
class TrackerStatistics:
    """Of all frames of some recordings; NaN where the log does not hold what is needed.

    Attributes:
        frames: reports counted.
        interval_s: usual time between images.
        delay_s: mean time from image to report.
        delay_std_s: its standard deviation.
        gaps: how many times at least one image is missing.
        lost: images that are missing.
        jumps: frames whose orientation is another of the cube's 24 than that of its neighbours.
        jump_frames: frames of a resting cube, in which jumps are counted.
        rest_height_m: of the centre of a cube that rests on a face, median.
        rest_noise_m: standard deviation of a coordinate of the resting cube.
        rest_noise_rad: standard deviation of a component of its rotation vector.
        confidence: mean.
    """

    frames: int
    interval_s: float
    delay_s: float
    delay_std_s: float
    gaps: int
    lost: int
    jumps: int
    jump_frames: int
    rest_height_m: float
    rest_noise_m: float
    rest_noise_rad: float
    confidence: float


def tracker_statistics(recordings: Sequence[Recording]) -> TrackerStatistics | None:
    """Statistics of the first object of each recording; None with too few frames to say anything."""
    cubes = [recording.objects[0] for recording in recordings if recording.objects]
    cubes = [_from(cube, cube.time_s >= 0.0) for cube in cubes]
    frames = sum(len(cube.time_s) for cube in cubes)
    if frames < _LEAST_FRAMES:
        return None
    intervals = [np.diff(cube.time_s) for cube in cubes]
    interval = float(np.median(np.concatenate(intervals)))
    missing = np.concatenate([np.round(times / max(interval, _SHORTEST_S)).astype(int) - 1 for times in intervals])
    delays = [cube.delivery_s - cube.time_s for cube in cubes if cube.delivery_s is not None]
    rests = [_resting(cube) for cube in cubes]
    angles = np.concatenate([rest.angle_rad for rest in rests])
    steps, turns = (np.concatenate([getattr(rest, name) for rest in rests]) for name in ("step_m", "turn_rad"))
    heights = np.concatenate([rest.height_m for rest in rests])
    confidences = [cube.confidence for cube in cubes if cube.confidence is not None]
    return TrackerStatistics(
        frames=frames,
        interval_s=interval,
        delay_s=_mean(delays),
        delay_std_s=float(np.sqrt(np.mean([np.var(delay) for delay in delays]))) if delays else np.nan,
        gaps=int((missing > 0).sum()),
        lost=int(missing.clip(0).sum()),
        jumps=int((angles > JUMP_RAD).sum()),
        jump_frames=len(angles),
        rest_height_m=float(np.median(heights)) if len(heights) else np.nan,
        rest_noise_m=_spread(steps),
        rest_noise_rad=_spread(turns[np.linalg.norm(turns, axis=1) < JUMP_RAD / 2**0.5]),
        confidence=_mean(confidences),
    )


@dataclass(frozen=True)
class _Rest:
    """Of a resting cube: heights (k,); from each frame to the next, scaled to one frame's noise, changes of place (j, 3) and

    rotation vectors (j, 3); and angles (k,) between each frame and the orientation that most frames about it agree on.
    """

    height_m: np.ndarray
    step_m: np.ndarray
    turn_rad: np.ndarray
    angle_rad: np.ndarray


def _from(cube: ObjectSignals, kept: np.ndarray) -> ObjectSignals:
    optional = [None if array is None else array[kept] for array in (cube.delivery_s, cube.confidence)]
    return ObjectSignals(cube.name, cube.body, cube.time_s[kept], cube.position_m[kept], cube.quat_wxyz[kept], *optional)


def _resting(cube: ObjectSignals) -> _Rest:
    usable = usable_frames(cube)
    place, matrix = cube.position_m[usable], rotation_matrices(cube.quat_wxyz[usable])
    half = _STILL_FRAMES // 2
    still, angles = np.zeros(len(place), dtype=bool), []
    for k in range(half, len(place) - half):
        about = slice(k - half, k + half + 1)
        usual = np.median(place[about], axis=0)
        still[k] = np.linalg.norm(np.median(np.abs(place[about] - usual), axis=0)) < _STILL_M and _together(place[about])
        if still[k]:
            angles.append(_angle_from_usual(matrix[about], half))
    pairs = np.flatnonzero(still[1:] & still[:-1])
    turns = np.array([_rotation_vector(matrix[k + 1] @ matrix[k].T) for k in pairs]).reshape(-1, 3)
    level = np.abs(matrix[:, 2, :]).max(axis=1) > _LEVEL  # not leaning on the wall
    return _Rest(place[still & level, 2], np.diff(place, axis=0)[pairs] / 2**0.5, turns / 2**0.5, np.array(angles))


def _together(place_m: np.ndarray) -> bool:
    """Whether the first and the second half of some frames lie at the same place."""
    half = len(place_m) // 2
    return bool(np.linalg.norm(np.median(place_m[:half], axis=0) - np.median(place_m[-half:], axis=0)) < _STILL_M)


def _angle_from_usual(matrix: np.ndarray, middle: int) -> float:
    """Angle between the middle frame and the one of the others that agrees with them best."""
    others = np.delete(matrix, middle, axis=0)
    agreement = np.einsum("aij,bij->ab", others, others)
    usual = others[agreement.sum(axis=1).argmax()]
    return float(np.arccos(np.clip((np.trace(matrix[middle] @ usual.T) - 1.0) / 2.0, -1.0, 1.0)))


def _rotation_vector(matrix: np.ndarray) -> np.ndarray:
    angle = float(np.arccos(np.clip((np.trace(matrix) - 1.0) / 2.0, -1.0, 1.0)))
    skew = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    size = float(np.linalg.norm(skew))
    return angle * skew / size if size > 1e-9 else np.array([angle, 0.0, 0.0])


def _spread(values: np.ndarray) -> float:
    """Robust standard deviation of numbers with mean 0, shape (k, 3)."""
    return float(np.median(np.abs(values)) / MEDIAN_SIZE) if len(values) else np.nan


def _mean(parts: Sequence[np.ndarray]) -> float:
    return float(np.mean(np.concatenate(parts))) if parts else np.nan
