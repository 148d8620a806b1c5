"""Sessions of simulated robots with a cube: one log of it at rest and one of fingers that push it, as a farm would give them.

As ``robot_farm/excitation_run.py`` runs an excitation, but for many robots at once: each has a course of its own that sees what
its own tracker reports. Physics runs at half the step that logs have: a fit sees no mirror image of its own model.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sim_backend.driver.driver import Command, Segment, Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import TrackedPose, Tracker
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.excitations.course import Sight, follow, hold
from sim_backend.excitations.cube_slide import slide_cube
from sim_backend.reality_gap.knowledge.healthy import CUBES_FILE, JOINTS_FILE
from sim_backend.reality_gap.recording import JointSignals, ObjectSignals, Recording
from sim_backend.reality_gap.subjects.cube.windows import LEAST_PUSHES, all_push_windows
from sim_backend.trifinger import constants as c

FINER = 2
"""Physics steps for each logged one."""
REST_S = 10.0
START_RADIUS_M = 0.085
"""Within this distance of the arena's centre the cube lies at the start; ``slide_cube`` needs it within 9 cm."""


def healthy_physics(rng: np.random.Generator, n: int) -> Physics:
    """Healthy robots with healthy trackers and cubes (``knowledge/healthy_*.toml``)."""
    joints, cube = (load_ranges(file).draw(rng, n) for file in (JOINTS_FILE, CUBES_FILE))
    return Physics(n, {**joints.given, **cube.given})


def cube_sessions(physics: Physics, seeds: Sequence[int], *, finer: int = FINER, threads: int = 1) -> list[list[Recording]]:
    """One session of each of n robots.

    Args:
        physics: of the n robots.
        seeds: n seeds, each of a start, a course and the noise.
        finer: physics steps for each logged one.
        threads: that simulate.

    Returns:
        For each robot the recordings of regime ``rest`` (10 s) and ``slide_cube`` (40 s).
    """
    n, step_s = physics.n, c.PHYSICS_STEP_S / finer
    driver = SimulatedDriver(robots=n, threads=threads, physics_step_s=step_s, physics=physics)
    rows: list[list[Recording]] = [[] for _ in range(n)]
    for regime, offset in (("rest", 0), ("slide_cube", 1)):
        rngs = [np.random.default_rng([seed, offset]) for seed in seeds]
        start = _start(driver, rngs)
        pose = np.tile(c.START_JOINT_POSITION_RAD, 1)
        courses = [follow(hold(pose, REST_S)) if regime == "rest" else slide_cube(rng) for rng in rngs]
        log = _run(driver, Tracker(physics_step_s=step_s, physics=physics), start, courses, finer)
        for i, seed in enumerate(seeds):
            rows[i].append(log.recording(i, f"{regime}-{seed}", regime))
    return rows


def more_pushes(physics: Physics, seeds: Sequence[int], attempt: int, *, finer: int = FINER) -> list[Recording]:
    """Another log of regime ``slide_cube`` of each of n robots, the cube placed anew; ``attempt`` counts from 1."""
    step_s = c.PHYSICS_STEP_S / finer
    driver = SimulatedDriver(robots=physics.n, physics_step_s=step_s, physics=physics)
    rngs = [np.random.default_rng([seed, 1, attempt]) for seed in seeds]
    start = _start(driver, rngs)
    courses = [slide_cube(rng) for rng in rngs]
    log = _run(driver, Tracker(physics_step_s=step_s, physics=physics), start, courses, finer)
    return [log.recording(i, f"slide_cube-{seed}-{attempt}", "slide_cube") for i, seed in enumerate(seeds)]


def sessions_with_pushes(physics: Physics, seeds: Sequence[int]) -> list[list[Recording]]:
    """Sessions as an operator records them: pushes again, with the cube placed anew, if a finger got at it fewer than 4 times."""
    sessions = cube_sessions(physics, seeds)
    for attempt in (1, 2):
        few = [i for i, recordings in enumerate(sessions) if len(all_push_windows(recordings)) < LEAST_PUSHES]
        if few:
            again = more_pushes(Physics.stack([physics.row(i) for i in few]), [seeds[i] for i in few], attempt)
            for i, recording in zip(few, again, strict=True):
                sessions[i].append(recording)
    return sessions


def _start(driver: SimulatedDriver, rngs: Sequence[np.random.Generator]) -> Start:
    """Cubes anywhere within reach, turned by any angle."""
    n = len(rngs)
    place, quat, seeds = np.zeros((n, 3)), np.zeros((n, 4)), np.zeros(n)
    for i, rng in enumerate(rngs):
        angle, yaw = rng.uniform(0.0, 2.0 * np.pi, 2)
        place[i, :2] = START_RADIUS_M * np.sqrt(rng.uniform()) * np.array([np.cos(angle), np.sin(angle)])
        quat[i] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)
        seeds[i] = rng.integers(0, 2**53)
    place[:, 2] = driver.rest_height_m(quat)
    return Start(np.tile(c.START_JOINT_POSITION_RAD, (n, 1)), place, quat, noise_seed=seeds)


@dataclass
class _Log:
    """What n robots measured so far; ``reports`` holds for each robot the reports that were delivered to it."""

    joints: dict[str, list[np.ndarray]] = field(default_factory=dict)
    reports: list[list[tuple]] = field(default_factory=list)

    def add_joints(self, segment: Segment, command: Command, finer: int) -> None:
        logged = {
            "position_rad": segment.joint_position_rad,
            "velocity_rad_s": segment.joint_velocity_rad_s,
            "commanded_torque_nm": segment.applied_torque_nm,
            "measured_torque_nm": segment.measured_torque_nm,
        }
        steps = segment.applied_torque_nm.shape[1] // finer
        for name, values in logged.items():
            self.joints.setdefault(name, []).append(values[:, ::finer].astype(np.float32))
        for name, values in (
            ("desired_torque_nm", command.desired_torque_nm),
            ("position_target_rad", command.position_target_rad),
        ):
            assert values is not None, "courses give targets"
            self.joints.setdefault(name, []).append(np.repeat(values[:, None], steps, axis=1).astype(np.float32))

    def add_report(self, report: TrackedPose, step_s: float) -> None:
        for i, kept in enumerate(self.reports):
            if report.confidence[i] > 0.0 and (not kept or report.capture_step[i] * step_s != kept[-1][0]):
                times = report.capture_step[i] * step_s, report.delivery_step[i] * step_s
                kept.append((*times, report.confidence[i], *report.cube_position_world_m[i], *report.cube_quat_wxyz[i]))

    def recording(self, i: int, name: str, regime: str) -> Recording:
        arrays = {key: np.concatenate([part[i] for part in parts]).astype(float) for key, parts in self.joints.items()}
        steps, rows = len(arrays["position_rad"]), np.array(self.reports[i])
        cube = ObjectSignals("cube", "cube", rows[:, 0], rows[:, 3:6], rows[:, 6:10], rows[:, 1], rows[:, 2])
        time_s = c.PHYSICS_STEP_S * np.arange(steps)
        joints = JointSignals(c.JOINT_NAMES, **arrays)  # pyrefly: ignore[bad-argument-type] - no arrays are outliers
        return Recording(name, "simulated", c.PHYSICS_STEP_S, time_s, joints, (cube,), regime=regime)


def _run(driver: SimulatedDriver, tracker: Tracker, start: Start, courses: list, finer: int) -> _Log:
    """Let every robot follow its course to the end; all courses take equally long."""
    driver.reset(start)
    step_s, step, n = c.PHYSICS_STEP_S / finer, 0, driver.robots
    log = _Log(reports=[[] for _ in range(n)])
    log.add_report(tracker.reset(driver.measure(), start.noise_seed), step_s)
    commands = [next(course) for course in courses]
    while True:
        target = np.concatenate([command.position_target_rad for command, _ in commands])
        command = Command(np.concatenate([command.desired_torque_nm for command, _ in commands]), target)
        segment = driver.advance([(command, commands[0][1] * finer)])
        step += commands[0][1] * finer
        tracker.capture(segment)
        for report in tracker.deliver(step):
            log.add_report(report, step_s)
        log.add_joints(segment, command, finer)
        state, seen = driver.measure(), tracker.reading(step)
        try:
            commands = [
                course.send(Sight(state.joint_position_rad[i], seen.cube_position_world_m[i], seen.cube_quat_wxyz[i]))
                for i, course in enumerate(courses)
            ]
        except StopIteration:
            return log
