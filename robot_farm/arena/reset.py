"""A robot and the object in its arena between trials: at rest, looked at, swept or placed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from robot_farm.alarm import jumped
from robot_farm.arena.motion import Motion
from robot_farm.arena.sweep import DRAWN_TO_M, REACH_M, plan_sweep, retreat, sweep
from robot_farm.sight import Sight
from sim_backend.driver.driver import Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import Shape

SWEEPS = 2
"""After so many sweeps that left the object out of reach it is placed."""
HAND_POSITION_M = 0.003
HAND_TURN_RAD = np.deg2rad(3.0)
"""Standard deviations of a placement by hand, along each axis of the table and about the vertical. Were it exact, the tracker's
first report beside the trial's seed, which everybody knows, would give away the errors of the cameras."""


class Arena:
    """The simulated place of one robot (n = 1). Owner of the driver and of the cameras outside a trial.

    ``is_placed`` says that nobody's fingers brought the object where it lies, ``is_settled`` that the fingers are in their
    start pose.
    """

    def __init__(self, driver: SimulatedDriver, start: Start, sight: Sight) -> None:
        self.driver, self._start, self._sight = driver, start, sight
        self.is_placed, self.is_settled = True, True

    @classmethod
    def new(cls, shape: Shape, physics: Physics, start: Start, sight: Sight | None = None) -> "Arena":
        """An arena with another object, placed."""
        driver = SimulatedDriver(physics=physics, shape=shape)
        start = by_encoders(driver, start)
        driver.reset(start)
        return cls(driver, start, Sight() if sight is None else sight)

    def wake(self, physics: Physics, noise_seed: int, rise_k: np.ndarray, stop_reason: Callable[[], str | None]) -> str | None:
        """After a pause in which everything came to rest: the physics of the next trial, and cameras that have seen nothing.

        Returns:
            Which encoder reports another position than before though nothing moved, as a sentence; None if none does.
        """
        before_rad = self.driver.measure().joint_position_rad
        self.driver.set_physics(physics)
        self.tracker = self._sight.tracker(physics, self.driver.shape)
        self.motion = Motion(self.driver, self.tracker, stop_reason)
        here = self._here()
        seed = np.array([noise_seed])
        self._restart(replace(here, noise_seed=seed, motor_temperature_rise_k=rise_k[None]))
        return jumped(np.concatenate([before_rad, self.driver.measure().joint_position_rad]))

    def change(self, physics: Physics) -> None:
        """Something befalls the robot, or passes."""
        self.driver.set_physics(physics)
        self.tracker.set_physics(physics)

    def place(self, start: Start) -> None:
        """Put the object where a start says, and the fingers there by their encoders; clock, seed and temperatures stay."""
        rise_k = self.driver.motor_temperature_rise_k
        position_m = start.cube_position_world_m.copy()
        position_m[:, 2] = self.driver.rest_height_m(start.cube_quat_wxyz)
        placed = replace(start, cube_position_world_m=position_m)
        placed = replace(placed, noise_seed=self._start.noise_seed, motor_temperature_rise_k=rise_k)
        self._restart(by_encoders(self.driver, placed))
        self.is_placed, self.is_settled = True, True

    def set_temperature(self, rise_k: np.ndarray) -> None:
        """Let the motors have another temperature, shape (9,), K above ambient; all is at rest."""
        self._restart(replace(self._here(), noise_seed=self._start.noise_seed, motor_temperature_rise_k=rise_k[None]))

    def start_here(self) -> Start:
        """The start of a trial that begins with everything as it is, at rest."""
        rise_k = self.driver.motor_temperature_rise_k
        return replace(self._here(), noise_seed=self._start.noise_seed, motor_temperature_rise_k=rise_k)

    def settle(self) -> np.ndarray | None:
        """Bring the fingers into their start pose unless they are there; returns as :meth:`bring_back`."""
        error_rad = None if self.is_settled else retreat(self.motion)
        self.is_settled = True
        return error_rad

    def bring_back(self, rng: np.random.Generator, events: list[str]) -> np.ndarray | None:
        """Sweep until the object is seen within reach, from the start pose and back to it; it is to be placed if it never is.

        Args:
            rng: says how far the object is drawn.
            events: told what happened, in numbers that the tracker reported.

        Returns:
            How far each joint was from where it should be after the last motion, shape (9,), rad; None if there was none.
        """
        error_rad = None
        for _ in range(SWEEPS):
            seen_m = self._seen_m()
            if _distance_m(seen_m) <= REACH_M or _distance_m(seen_m) > c.ARENA_RADIUS_M:
                break
            self.is_settled = False  # should the sweep be stopped
            error_rad = sweep(self.motion, plan_sweep(seen_m, self.driver.shape, rng.uniform(*DRAWN_TO_M)))
            self.is_settled = True
            before_mm, after_mm = 1000 * _distance_m(seen_m), 1000 * _distance_m(self._seen_m())
            events.append(
                f"a sweep: the object was seen {before_mm:.0f} mm from the centre before it, {after_mm:.0f} mm after it"
            )
        if _distance_m(self._seen_m()) > REACH_M:
            events.append("the object is seen out of reach")
            self.is_placed = True
        return error_rad

    def _seen_m(self) -> np.ndarray:
        """Where the tracker saw the object last, shape (3,)."""
        return self.tracker.latest.cube_position_world_m[0]

    def _here(self) -> Start:
        now = self.driver.measure()
        return Start(now.true_joint_position_rad, now.cube_position_world_m, now.cube_quat_wxyz)

    def _restart(self, start: Start) -> None:
        self._start = start
        self.driver.reset(start)
        self.tracker.reset(self.driver.measure(), start.noise_seed)
        self.motion.step = 0


def by_encoders(driver: SimulatedDriver, start: Start) -> Start:
    """The start (n = 1) of a robot that moves its joints until its encoders, for all that they are off, report what is wanted."""
    driver.reset(start)
    now = driver.measure()
    true_rad = start.joint_position_rad - (now.joint_position_rad - now.true_joint_position_rad)
    return replace(start, joint_position_rad=np.clip(true_rad, c.SOFT_LIMIT_LOWER_RAD, c.SOFT_LIMIT_UPPER_RAD))


def by_hand(start: Start, rng: np.random.Generator) -> Start:
    """The start (n = 1) as a person leaves the object who means to put it there: a little beside it and turned, within reach."""
    position_m = start.cube_position_world_m.copy()
    position_m[0, :2] += rng.normal(0.0, HAND_POSITION_M, 2)
    position_m[0, :2] *= min(1.0, REACH_M / max(_distance_m(position_m[0]), REACH_M))
    half_rad = rng.normal(0.0, HAND_TURN_RAD) / 2
    w, x, y, z = start.cube_quat_wxyz[0]
    cosine, sine = np.cos(half_rad), np.sin(half_rad)  # turned about the vertical after its own orientation
    turned = [cosine * w - sine * z, cosine * x - sine * y, cosine * y + sine * x, cosine * z + sine * w]
    return replace(start, cube_position_world_m=position_m, cube_quat_wxyz=np.array([turned]))


def _distance_m(position_world_m: np.ndarray) -> float:
    """From the arena's vertical axis."""
    return float(np.hypot(position_world_m[0], position_world_m[1]))
