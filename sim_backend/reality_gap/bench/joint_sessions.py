"""Sessions of simulated robots with known physics: the standard excitation, measured as a farm's log would have it.

Whoever fits them works on equations along the measured motion, not on a simulation: it is no mirror image of this one.
"""

from collections.abc import Mapping

import numpy as np

from sim_backend.driver.driver import Command, Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.excitations.excitation import EXCITATIONS
from sim_backend.reality_gap.knowledge.healthy import JOINTS_FILE, STANDARD
from sim_backend.reality_gap.knowledge.joint_effects import SEEN, Sign
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.trifinger import constants as c

IN_THE_AIR = tuple(sorted((name for name, each in EXCITATIONS.items() if not each.sees_cube), key=lambda name: name != STANDARD))
"""Excitations that follow from the generator alone, the standard one first."""
EVERYTHING = "everything"
"""All of these, as ``trifarm identify`` records them."""
FINER = 1
"""Physics steps for each logged one."""
_JUMP = SEEN[Sign.POSITION_JUMP]
_JUMP_AFTER = 2137  # commands
_OUT_OF_THE_WAY_M = 1e5  # the cube falls freely for the whole session: contacts would cost most of the time


def healthy_physics(seed: int) -> Physics:
    """One robot that is a little off everywhere, as healthy ones are (``knowledge/healthy_joints.toml``)."""
    return load_ranges(JOINTS_FILE).draw(np.random.default_rng([seed, 1]), 1)


def simulated_recordings(
    physics: Physics, seeds: list[int], excitation: str, *, jumps: Mapping[int, tuple[int, float]] | None = None
) -> list[tuple[Recording, ...]]:
    """For each of n robots the recordings that a study of it has: one, or with ``EVERYTHING`` one of each excitation.

    Args:
        physics: of the n robots.
        seeds: n seeds, as for :func:`simulated_sessions`.
        excitation: name of a course, or ``EVERYTHING``.
        jumps: as for :func:`simulated_sessions`, in the standard session alone: before the next one a robot finds its zero again.
    """
    excitations = IN_THE_AIR if excitation == EVERYTHING else (excitation,)
    shown = [
        simulated_sessions(physics, seeds, excitation=name, jumps=jumps if name == STANDARD else None) for name in excitations
    ]
    return list(zip(*shown, strict=True))


def simulated_sessions(
    physics: Physics,
    seeds: list[int],
    *,
    excitation: str = STANDARD,
    finer: int = FINER,
    threads: int = 1,
    jumps: Mapping[int, tuple[int, float]] | None = None,
) -> list[Recording]:
    """One session of each of n robots.

    Args:
        physics: of the n robots.
        seeds: n seeds, each of a course and of the noise.
        excitation: name of a course that needs no sight of the cube.
        finer: physics steps for each logged one.
        threads: that simulate.
        jumps: encoders that lose counts in the middle: by robot, the joint and the offset in rad.

    Returns:
        What the robots measured, at 1 kHz.
    """
    n, whole = physics.n, EXCITATIONS[excitation]
    driver = SimulatedDriver(robots=n, threads=threads, physics_step_s=c.PHYSICS_STEP_S / finer, physics=physics)
    place = np.tile([[0.0, 0.0, _OUT_OF_THE_WAY_M]], (n, 1)), np.tile([[1.0, 0.0, 0.0, 0.0]], (n, 1))
    driver.reset(Start(np.tile(c.START_JOINT_POSITION_RAD, (n, 1)), *place, noise_seed=np.array(seeds)))
    courses = [whole.course(np.random.default_rng(seed)) for seed in seeds]
    commands = [next(course) for course in courses]
    parts: dict[str, list[np.ndarray]] = {}
    while commands:
        target = np.concatenate([t for command, _ in commands if (t := command.position_target_rad) is not None])
        torque = np.concatenate([command.desired_torque_nm for command, _ in commands])
        steps = commands[0][1]
        if jumps and len(parts.get("position_rad", ())) == _JUMP_AFTER:
            lost = driver.physics.value(_JUMP).copy()
            for robot, (joint, offset_rad) in jumps.items():
                lost[robot, joint] = offset_rad
            driver.set_physics(driver.physics.changed({_JUMP: lost}))
        segment = driver.advance([(Command(torque, target), steps * finer)])
        logged = {
            "position_rad": segment.joint_position_rad,
            "velocity_rad_s": segment.joint_velocity_rad_s,
            "commanded_torque_nm": segment.applied_torque_nm,
            "measured_torque_nm": segment.measured_torque_nm,
        }
        for name, values in logged.items():
            parts.setdefault(name, []).append(values[:, ::finer])
        parts.setdefault("desired_torque_nm", []).append(np.repeat(torque[:, None], steps, axis=1))
        parts.setdefault("position_target_rad", []).append(np.repeat(target[:, None], steps, axis=1))
        try:
            commands = [course.send(None) for course in courses]  # pyrefly: ignore[bad-argument-type] - nobody looks
        except StopIteration:
            commands = []
    arrays = {name: np.concatenate(values, axis=1) for name, values in parts.items()}
    return [
        _recording(f"{excitation}-{seed}", excitation, {name: values[i] for name, values in arrays.items()})
        for i, seed in enumerate(seeds)
    ]


def _recording(name: str, excitation: str, arrays: dict[str, np.ndarray]) -> Recording:
    steps = len(arrays["position_rad"])
    time_s = c.PHYSICS_STEP_S * np.arange(steps)
    joints = JointSignals(c.JOINT_NAMES, **arrays)  # pyrefly: ignore[bad-argument-type] - no arrays are outliers
    return Recording(name, "simulated", c.PHYSICS_STEP_S, time_s, joints, regime=excitation)
