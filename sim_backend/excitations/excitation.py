"""Excitations: motions that a robot is made to do so that its physics shows in what it measures.

A course (``course.py``) gives one command after the other and is sent what the robot saw::

    course = EXCITATIONS["chirps"].course(rng)
    command, steps = next(course)
    while True:
        segment = driver.advance([(command, steps)])
        command, steps = course.send(sight)  # StopIteration at the end

Courses begin at the start position. Only ``slide_cube`` looks at the sight, and needs the cube within 9 cm of the centre; the
others follow from the generator of random numbers alone, keep the tips above the cube wherever it lies on the floor, and keep
each finger in a third of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim_backend.excitations.course import Course, command_times_s, commands, follow, glide, hold
from sim_backend.excitations.cube_slide import slide_cube
from sim_backend.trifinger import constants as c

RAISED_RAD = np.array([0.0, 1.2, -2.2])
"""One finger's joints, tip 15 cm above the table: 3 cm from everything else while any single joint moves over its range."""
LOWER_RAD, UPPER_RAD = np.array([-0.3, 0.9, -2.6]), np.array([0.2, 1.5, -1.9])
"""Between these, each finger for itself, fingers stay 7 cm apart and the tips 8 cm above the table."""
REACHABLE_UPPER_RAD = np.array([1.0, 1.57, -1.7])
"""Upper ends that a finger can be led to; the last joint's own end lies behind the table and the wall."""
BEYOND_LIMIT_RAD = 0.02
_RAISE_S = 1.5


@dataclass(frozen=True)
class Excitation:
    """A named motion of a fixed length; ``course`` makes it from a generator of random numbers.

    ``sees_cube`` says whether it follows what the tracker reports of the cube.
    """

    name: str
    duration_s: float
    about: str
    course: Callable[[np.random.Generator], Course]
    sees_cube: bool = False


def slow_ramps(rng: np.random.Generator) -> Course:
    """Speed of one joint after the other as slow triangles through zero: friction at rest and just beside it."""
    stretches = []
    for joint in range(3):
        for period_s, speed_rad_s in ((4.0, 0.2), (8.0, 0.06)):
            speeds = rng.uniform(0.7, 1.0, 3) * rng.choice([-1.0, 1.0], 3) * speed_rad_s
            stretches.append(_raised(joint, speeds * _ramp(period_s)[:, None]))
    return _whole(40.0, *stretches)


def fast_sweeps(rng: np.random.Generator) -> Course:
    """Quick moves between ends, first with single joints, then with all: viscous friction, inertia, torque limits."""
    stretches = []
    for joint in range(3):
        ends = np.tile(np.where(np.arange(3) == joint, LOWER_RAD, RAISED_RAD), 3)
        other_ends = np.tile(np.where(np.arange(3) == joint, UPPER_RAD, RAISED_RAD), 3)
        stretches.append(_moves(rng, ends, other_ends, 5.0))
    stretches.append(_moves(rng, np.tile(LOWER_RAD, 3), np.tile(UPPER_RAD, 3), 2.5))
    return _whole(20.0, *stretches)


def chirps(rng: np.random.Generator) -> Course:
    """One joint after the other: a position chirp of 0.3 to 5 Hz, then a torque chirp of 1 to 20 Hz: inertia, delay, damping."""
    targets, torques = [], []
    for joint in range(3):
        phases = rng.uniform(0, 2 * np.pi, 3)
        positions = _raised(joint, 0.12 * _chirp(0.3, 5.0, 6.0, phases))
        pushes = np.zeros((commands(6.0), 9))
        pushes[:, joint::3] = 0.08 * _chirp(1.0, 20.0, 6.0, phases)
        targets += [positions, hold(np.tile(RAISED_RAD, 3), 6.0)]
        torques += [np.zeros_like(positions), pushes]
    return _whole(40.0, *targets, torques=torques)


def joint_limits(rng: np.random.Generator) -> Course:
    """Joints led outward to one end of their range, pressed on it, and led inward and on to the other (Dactyl)."""
    stretches = []
    for joint in range(3):
        ends = [c.SOFT_LIMIT_LOWER_RAD[joint] - BEYOND_LIMIT_RAD, REACHABLE_UPPER_RAD[joint]]
        ends[1] += BEYOND_LIMIT_RAD if ends[1] == c.SOFT_LIMIT_UPPER_RAD[joint] else 0.0
        first, second = (np.where(np.arange(3) == joint, end, RAISED_RAD) for end in rng.permutation(ends))
        for start, end, move_s, stay_s in (
            (RAISED_RAD, first, 3.0, 0.5),
            (first, second, 5.0, 0.5),
            (second, RAISED_RAD, 2.5, 0.5),
        ):
            stretches += [glide(np.tile(start, 3), np.tile(end, 3), move_s), hold(np.tile(end, 3), stay_s)]
    return _whole(40.0, *stretches)


def oscillations(rng: np.random.Generator) -> Course:
    """All joints swing at once, each as a sum of four sines of 0.3 to 3 Hz (Dactyl): coupling, inertia, backlash."""
    times = command_times_s(18.0)
    frequencies, phases = np.exp(rng.uniform(np.log(0.3), np.log(3.0), (4, 9))), rng.uniform(0, 2 * np.pi, (4, 9))
    swings = np.sin(2 * np.pi * frequencies * times[:, None, None] + phases).mean(axis=1)
    envelope = np.clip(np.minimum(times, times[-1] - times) / 1.0, 0.0, 1.0)[:, None]
    centre, reach = np.tile((LOWER_RAD + UPPER_RAD) / 2, 3), np.tile((UPPER_RAD - LOWER_RAD) / 2, 3)
    rest = np.tile(RAISED_RAD, 3)
    return _whole(20.0, rest + envelope * (centre - rest + reach * swings))


def hold_poses(rng: np.random.Generator) -> Course:
    """Nine poses, held for 2 s and reached from alternating sides: gravity, encoder offsets, friction, backlash, heat."""
    stretches, here = [], np.tile(RAISED_RAD, 3)
    for index in range(9):
        pose = rng.uniform(np.tile(LOWER_RAD + 0.06, 3), np.tile(UPPER_RAD - 0.06, 3))
        aside = pose + (0.06 if index % 2 else -0.06)
        stretches += [glide(here, aside, 1.2), hold(aside, 0.3), glide(aside, pose, 0.5), hold(pose, 2.0)]
        here = pose
    return _whole(40.0, *stretches)


def standard(rng: np.random.Generator) -> Course:
    """A little of everything on all joints in 40 s: the session that the detection limits of the reality gap are stated for."""
    raised, stretches, torques = np.tile(RAISED_RAD, 3), [], []
    periods_s = np.array([rng.permutation([10.0 / 3, 5.0, 10.0]) for _ in range(3)]).ravel()
    signs = rng.choice([-1.0, 1.0], 9)
    ways = [np.tile(_ramp(period), round(10.0 / period))[: commands(10.0)] for period in periods_s]
    ways = [np.pad(way, (0, commands(10.0) - len(way)), mode="edge") for way in ways]
    peaks_rad_s = rng.uniform(0.15, 0.2, 9) * np.minimum(1.0, 5.0 / periods_s)
    stretches.append(raised + (signs * peaks_rad_s) * np.stack(ways, axis=1))
    for joint in range(3):
        stretches.append(_raised(joint, 0.12 * _chirp(0.3, 5.0, 2.5, rng.uniform(0, 2 * np.pi, 3))))
    torques.append(np.zeros((sum(map(len, stretches)), 9)))
    for joint in range(3):
        pushes = np.zeros((commands(2.0), 9))
        pushes[:, joint::3] = 0.08 * _chirp(1.0, 20.0, 2.0, rng.uniform(0, 2 * np.pi, 3))
        stretches.append(hold(raised, 2.0))
        torques.append(pushes)
    stretches.append(_moves(rng, np.tile(LOWER_RAD, 3), np.tile(UPPER_RAD, 3), 5.5))
    for joint in range(3):
        ends = [c.SOFT_LIMIT_LOWER_RAD[joint] - BEYOND_LIMIT_RAD, REACHABLE_UPPER_RAD[joint]]
        ends[1] += BEYOND_LIMIT_RAD if ends[1] == c.SOFT_LIMIT_UPPER_RAD[joint] else 0.0
        first, second = (np.tile(np.where(np.arange(3) == joint, end, RAISED_RAD), 3) for end in rng.permutation(ends))
        stretches += [glide(raised, first, 0.8), hold(first, 0.25), glide(first, second, 1.2), hold(second, 0.25)]
        stretches.append(glide(second, raised, 0.6))
    return _whole(40.0, *stretches, torques=torques)


def _whole(seconds: float, *targets: np.ndarray, torques: list[np.ndarray] | None = None) -> Course:
    """Stretches of targets (k, 9) between the way up and a rest that fills the time."""
    start, raised = c.START_JOINT_POSITION_RAD, np.tile(RAISED_RAD, 3)
    path = np.concatenate([glide(start, raised, _RAISE_S), *targets])
    path = np.concatenate([path, np.repeat(path[-1:], commands(seconds) - len(path), axis=0)])
    torque = np.zeros_like(path)
    if torques is not None:
        pushes = np.concatenate(torques)
        torque[commands(_RAISE_S) : commands(_RAISE_S) + len(pushes)] = pushes
    return follow(path, torque)


def _raised(joint: int, offset_rad: np.ndarray) -> np.ndarray:
    """Targets of raised fingers of which one joint is moved, offsets of shape (k, 3); shape (k, 9)."""
    targets = np.repeat(np.tile(RAISED_RAD, 3)[None], len(offset_rad), axis=0)
    targets[:, joint::3] += offset_rad
    return targets


def _ramp(period_s: float) -> np.ndarray:
    """Way of a motion whose speed is one triangle up to 1 and one down to -1, shape (k,), s."""
    share = command_times_s(period_s) / period_s
    speed = np.interp(share, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])
    return np.cumsum(speed) * period_s / len(share)


def _chirp(first_hz: float, last_hz: float, seconds: float, phases_rad: np.ndarray) -> np.ndarray:
    """Sines whose frequency grows by a constant factor per second, faded in and out; shapes (3,) and (k, 3)."""
    times = command_times_s(seconds)
    rate = np.log(last_hz / first_hz) / seconds
    cycles = first_hz * np.expm1(rate * times) / rate
    fade = np.clip(np.minimum(times, times[-1] - times) / 0.5, 0.0, 1.0)
    return fade[:, None] * np.sin(2 * np.pi * cycles[:, None] + phases_rad)


def _moves(rng: np.random.Generator, ends_rad: np.ndarray, other_ends_rad: np.ndarray, seconds: float) -> np.ndarray:
    """Each finger moves to and fro between two poses (9,) in times of its own; ends raised; shape (k, 9)."""
    fingers = []
    for finger in range(3):
        ends = [ends_rad[3 * finger : 3 * finger + 3], other_ends_rad[3 * finger : 3 * finger + 3]]
        path, here, count = [], RAISED_RAD, 0
        while (left := commands(seconds - 0.8) - sum(map(len, path))) > 0:
            move, stay = glide(here, ends[count % 2], rng.uniform(0.2, 0.5)), hold(ends[count % 2], rng.uniform(0.05, 0.2))
            path.append(np.concatenate([move, stay])[:left])
            here, count = path[-1][-1], count + 1
        fingers.append(np.concatenate([*path, glide(here, RAISED_RAD, 0.8)]))
    return np.concatenate(fingers, axis=1)


EXCITATIONS: dict[str, Excitation] = {
    excitation.name: excitation
    for excitation in (
        Excitation("slow_ramps", 40.0, "one joint after the other at slow speeds through zero", slow_ramps),
        Excitation("fast_sweeps", 20.0, "quick moves between ends, with single joints and with all", fast_sweeps),
        Excitation("chirps", 40.0, "position and torque chirps, one joint after the other", chirps),
        Excitation("joint_limits", 40.0, "each joint outward to an end, inward and to the other end", joint_limits),
        Excitation("oscillations", 20.0, "all joints swing at once", oscillations),
        Excitation("hold_poses", 40.0, "poses held still, reached from alternating sides", hold_poses),
        Excitation("standard", 40.0, "a little of everything on all joints", standard),
        Excitation("slide_cube", 40.0, "a finger pushes the cube and lets it slide", slide_cube, sees_cube=True),
    )
}
