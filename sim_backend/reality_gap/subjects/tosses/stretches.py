"""What the recorded poses of one object show by themselves: where it flies, where it rests, and from where it can be replayed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sim_backend.reality_gap.recording import Recording
from sim_backend.reality_gap.subjects.tosses.geometry import ObjectGeometry, gaps_m

_FLIGHT_MARGIN = 0.08  # of the object's radius: farther from everything than this it touches nothing, whatever is a little wrong
_TRIM = 2  # samples left out at both ends of a flight: smoothing mixes them with the contact
_MIN_FLIGHT = 7  # samples
_START_SPAN_S, _START_SAMPLES = 0.05, (4, 12)  # of the fit that gives the state from which a replay starts
_REST_S, _REST_TRAVEL, _REST_TURN_RAD = 0.04, 0.01, 0.01  # least duration; most travel in radii; most turn
_MOVES = 0.2  # radii: less travel than this shows nothing of contacts
_LONGEST_S = 2.0  # of a replay: later nothing is learnt but that it lies there
_GAP_STEPS = 2.5  # median steps without a sample end a stretch


@dataclass(frozen=True)
class Flight:
    """A stretch without contact: mean acceleration of the body's origin (3,), m/s^2, and its duration, s."""

    acceleration_m_s2: np.ndarray
    duration_s: float


@dataclass(frozen=True)
class Toss:
    """One stretch of one recording without gaps, from a state that is known well.

    Attributes:
        episode: index of the recording it is from; the unit of every split.
        name: of the recording.
        time_s: from the replay's start, shape (m,).
        position_m: measured, shape (m, 3).
        quat_wxyz: measured, shape (m, 4).
        velocity_m_s: at the start, in the world's frame, shape (3,).
        angular_velocity_rad_s: at the start, in the body's frame, shape (3,).
        velocity_std_m_s: standard deviation of each component of the velocity, from the scatter about its fit.
        angular_velocity_std_rad_s: of the angular velocity.
        moves: whether the object moves at all after the start.
        flights: stretches without contact.
        rest: positions (k, 3) and orientations (k, 4), one for each stretch at rest.
    """

    episode: int
    name: str
    time_s: np.ndarray
    position_m: np.ndarray
    quat_wxyz: np.ndarray
    velocity_m_s: np.ndarray
    angular_velocity_rad_s: np.ndarray
    velocity_std_m_s: float
    angular_velocity_std_rad_s: float
    moves: bool
    flights: tuple[Flight, ...]
    rest: tuple[np.ndarray, np.ndarray]


def tosses_of(geometry: ObjectGeometry, recordings: Sequence[Recording]) -> list[Toss]:
    """All stretches of the object that are long enough to say anything."""
    found = []
    for episode, recording in enumerate(recordings):
        for signals in recording.objects:
            if signals.body == geometry.body:
                for rows in _pieces(signals.time_s, signals.position_m, signals.quat_wxyz):
                    toss = _toss(geometry, episode, recording.name, *rows)
                    if toss is not None:
                        found.append(toss)
    return found


def _pieces(
    time_s: np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Rows between missing samples and gaps in time."""
    good = np.isfinite(position_m).all(1) & np.isfinite(quat_wxyz).all(1) & np.isfinite(time_s)
    time_s, position_m, quat_wxyz = time_s[good], position_m[good], quat_wxyz[good]
    if len(time_s) < 2:
        return
    step_s = np.median(np.diff(time_s))
    cuts = np.flatnonzero(np.diff(time_s) > _GAP_STEPS * step_s) + 1
    for rows in np.split(np.arange(len(time_s)), cuts):
        yield time_s[rows], position_m[rows], quat_wxyz[rows]


def _toss(
    geometry: ObjectGeometry, episode: int, name: str, time_s: np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray
) -> Toss | None:
    if len(time_s) < _MIN_FLIGHT:
        return None
    free = gaps_m(geometry.model, geometry, position_m, quat_wxyz) > _FLIGHT_MARGIN * geometry.radius_m
    flights = [_flight(time_s[a:b], position_m[a:b]) for a, b in _runs(free, time_s)]
    start, starts_free = _start(free)
    rows = (time_s >= time_s[start]) & (time_s <= time_s[start] + _LONGEST_S)
    span = _start_rows(time_s, start, free if starts_free else None)
    (velocity, velocity_std), (angular, angular_std) = start_velocities(
        time_s[span] - time_s[start], position_m[span], quat_wxyz[span]
    )
    return Toss(
        episode,
        name,
        time_s[rows] - time_s[start],
        position_m[rows],
        quat_wxyz[rows] / np.linalg.norm(quat_wxyz[rows], axis=1, keepdims=True),
        velocity,
        angular,
        velocity_std,
        angular_std,
        bool(np.ptp(position_m[rows], axis=0).max() > _MOVES * geometry.radius_m),
        tuple(flights),
        _rests(geometry, time_s, position_m, quat_wxyz),
    )


def _runs(free: np.ndarray, time_s: np.ndarray) -> Iterator[tuple[int, int]]:
    """Begin and end of the stretches without contact, without their ends."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        a = begin if begin == 0 else begin + _TRIM
        b = end if end == len(time_s) else end - _TRIM
        if b - a >= _MIN_FLIGHT:
            yield a, b


def _flight(time_s: np.ndarray, position_m: np.ndarray) -> Flight:
    curve = np.polyfit(time_s - time_s.mean(), position_m, 2)
    return Flight(2.0 * curve[0], float(time_s[-1] - time_s[0]))


def _start(free: np.ndarray) -> tuple[int, bool]:
    """First sample of the first flight that is long enough to measure a velocity in, else the first sample."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        first = begin if begin == 0 else begin + _TRIM
        if end - first >= _START_SAMPLES[0] + _TRIM:
            return int(first), True
    return 0, False


def _start_rows(time_s: np.ndarray, start: int, free: np.ndarray | None) -> slice:
    """Samples that give the velocity at the start: as many as 50 ms hold, none of them in contact if it starts free."""
    end = start + int(np.clip(np.searchsorted(time_s, time_s[start] + _START_SPAN_S) - start, *_START_SAMPLES))
    if free is not None and not free[start:].all():
        end = min(end, max(start + int(np.argmin(free[start:])) - _TRIM, start + _START_SAMPLES[0]))
    return slice(start, min(end, len(time_s)))


def start_velocities(
    time_s: np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray
) -> tuple[tuple[np.ndarray, float], tuple[np.ndarray, float]]:
    """Velocities at time 0 from the poses around it: a parabola through positions and one through rotations.

    Velocities that a data set brings along are not used: they may lie half a step off, or in another frame.

    Args:
        time_s: shape (n,).
        position_m: shape (n, 3).
        quat_wxyz: shape (n, 4).

    Returns:
        Linear velocity in the world's frame (3,), m/s, and the standard deviation of its components; angular velocity in the
        body's frame (3,), rad/s, and that of its components.
    """
    turn = np.empty((len(time_s), 3))
    for row, quat in enumerate(quat_wxyz):
        mujoco.mju_subQuat(turn[row], quat / np.linalg.norm(quat), quat_wxyz[0] / np.linalg.norm(quat_wxyz[0]))
    return _slope(time_s, position_m), _slope(time_s, turn)


def _slope(time_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, float]:
    """Derivative at time 0 of a parabola (of a line through few samples), and its standard deviation."""
    degree = 2 if len(time_s) > 4 else 1
    terms = np.vander(time_s, degree + 1)
    curve, *_ = np.linalg.lstsq(terms, values, rcond=None)
    free = max(len(time_s) - degree - 1, 1)
    variance = np.sum((values - terms @ curve) ** 2) / (3 * free)
    return curve[-2], float(np.sqrt(variance * np.linalg.inv(terms.T @ terms)[-2, -2]))


def _rests(
    geometry: ObjectGeometry, time_s: np.ndarray, position_m: np.ndarray, quat_wxyz: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean pose of each stretch in which neither position nor orientation moves, beside something."""
    poses, begin = [], 0
    travel, turn = _REST_TRAVEL * geometry.radius_m, np.cos(_REST_TURN_RAD / 2.0)
    while begin < len(time_s):
        near = (np.linalg.norm(position_m[begin:] - position_m[begin], axis=1) < travel) & (
            np.abs(quat_wxyz[begin:] @ quat_wxyz[begin]) > turn
        )
        end = begin + (len(near) if near.all() else int(np.argmin(near)))
        if time_s[end - 1] - time_s[begin] >= _REST_S and end - begin >= 4:
            quats = quat_wxyz[begin:end] * np.sign(quat_wxyz[begin:end] @ quat_wxyz[begin])[:, None]
            poses.append((position_m[begin:end].mean(0), quats.mean(0) / np.linalg.norm(quats.mean(0))))
        begin = max(end, begin + 1)
    if not poses:
        return np.zeros((0, 3)), np.zeros((0, 4))
    position, quat = np.array([p for p, _ in poses[-1:]]), np.array([q for _, q in poses[-1:]])
    beside = gaps_m(geometry.model, geometry, position, quat) < 0.3 * geometry.radius_m
    return position[beside], quat[beside]
