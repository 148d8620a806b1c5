"""What a robot does between trials: it cools, tests itself, brings the object back, and comes to know when it is unfit.

All of it happens within the lease of the next trial, before that begins, but for the look at itself with which a trial ends:
a robot that broke in a trial says so with this trial's outcome, not with the next one's.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import NoReturn

import numpy as np

from api_schemas.robot import Lease
from robot_farm.alarm import Alarm
from robot_farm.arena.cooling import BETWEEN_TRIALS_S, cooled_k, pause_s
from robot_farm.arena.motion import START_RAD
from robot_farm.arena.reset import Arena, by_hand
from robot_farm.arena.self_test import LOOK_AGAIN_S, blind_camera, try_joints, try_sight, wrong_joint
from robot_farm.arena.sweep import retreat
from robot_farm.faults import RESTART_S, Change, Fault, draw_fault, timeline
from robot_farm.link.lease_keeper import TrialStoppedError
from robot_farm.prepared import Prepared, TrialPhysics, draw_start_and_goal, shape_of_lease
from robot_farm.settings import Reset
from robot_farm.sight import Sight
from robot_farm.trial import measured_channels
from robot_farm.truth import TruthFile
from sim_backend.driver.driver import Start
from sim_backend.driver.simulated import PhysicsDivergedError, SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import draw_start
from sim_backend.trifinger import constants as c
from sim_backend.trifinger.objects import CUBE, Shape
from trial_logs.trial_log import LogChannels

StopReason = Callable[[], str | None]


class OutOfServiceError(Exception):
    """The robot found itself unfit; the message says what is wrong with it."""


@dataclass
class Life:
    """One robot's life. Owner of its driver, the temperature of its motors, its faults and the count of its trials.

    Args:
        robot: its name.
        draw: gives the physics of an attempt at a trial from the trial's seed and the attempt's number.
        reset: how the arena is made ready.
        faults: those that befall this robot by schedule.
        fault_rate: probability of a fault by chance in each trial.
        self_test_every: trials from one self-test to the next.
        physics_digest: of what its farm's physics are, as others are told.
        sight: what finds the object for it.
    """

    robot: str
    draw: Callable[[int | str, int], TrialPhysics]
    reset: Reset
    faults: tuple[Fault, ...] = ()
    fault_rate: float = 0.0
    self_test_every: int = 5
    physics_digest: str = ""
    sight: Sight = field(default_factory=Sight)
    wrong: str | None = None
    """Why the robot is out of service, None while it serves."""
    _arena: Arena | None = None
    _rise_k: np.ndarray = field(default_factory=lambda: np.zeros(9))
    _by_chance: list[Fault] = field(default_factory=list)
    _trials: int = 0
    _since_test: int | None = None
    """Trials since the last self-test; None if there was none."""
    _tests: int = 0
    tests_ended: int = 0
    """Self-tests that came to an end, whatever they found."""

    def log_channels(self) -> LogChannels:
        """The channels of its logs, which hold nothing but what a real robot could give."""
        return measured_channels()

    @property
    def driver(self) -> SimulatedDriver:
        """The robot's driver; another one when there is another object in the arena."""
        assert self._arena is not None, "prepare the robot first"
        return self._arena.driver

    def prepare(self, lease: Lease, truth: TruthFile, stop_reason: StopReason) -> Prepared:
        """Make robot and arena ready for a leased trial.

        Raises:
            OutOfServiceError: the robot is unfit.
            TrialStoppedError: there was a reason to stop.
        """
        drawn, shape, events = self.draw(lease.seed, lease.fence), shape_of_lease(lease), list[str]()
        self._let_chance_act(drawn.rng)
        physics, changes = timeline(drawn.physics, self._all_faults, self._trials)
        placed, goal = draw_start_and_goal(lease, TASKS, shape)
        placed = by_hand(placed, drawn.rng)
        arena, jump = self._enter(shape, physics, drawn.noise_seed, placed, stop_reason)
        if jump is not None:
            self._fail(jump)
        self._cool(arena, physics, events)
        if self._since_test is None or self._since_test >= self.self_test_every:
            self._test(arena, drawn.rng, events)
        self._trust(arena.settle(), "the way back", arena, drawn.rng, events)
        if self.reset is Reset.SWEEP and not arena.is_placed:
            self._trust(arena.bring_back(drawn.rng, events), "the sweep", arena, drawn.rng, events)
        own_start = lease.own_goal is not None and lease.own_goal.start is not None
        if self.reset is Reset.PLACEMENT or arena.is_placed or own_start:
            arena.place(placed)
            events.append("the object was placed")
        self._trials += 1
        self._since_test = (self._since_test or 0) + 1
        start = arena.start_here()
        arena.is_settled = arena.is_placed = False
        alarm = Alarm()
        return Prepared(
            start=start,
            goal=goal,
            tracker=arena.tracker,
            task=TASKS.get(lease.task.value),
            physics=physics,
            changes=changes,
            events=tuple(events),
            truth=truth,
            alarm=alarm,
            detector=self.sight.detector,
            close=lambda step, failed: self._close(
                arena, alarm.jump, physics_at(physics, changes, step), drawn.rng, failed=failed
            ),
        )

    def test_in_turn(self, turn: AbstractContextManager[None], stop_reason: StopReason) -> str | None:
        """Test the robot outside any lease while it has its turn on its core; a test that breaks off counts as failed.

        Returns:
            What is wrong, or that it passed; None if the test was stopped.
        """
        try:
            with turn:
                return self.test_again(stop_reason) or "passed"
        except TrialStoppedError:
            return None
        except Exception as error:
            self.forget()
            self.wrong = f"the self-test broke off: {type(error).__name__}: {error}"
            return self.wrong

    def test_again(self, stop_reason: StopReason) -> str | None:
        """Test the robot outside any lease: at its start, and when an operator wants it back in service.

        Whoever sends for that has been there: faults that came by chance are mended, scheduled ones stay.

        Returns:
            What is wrong, None if nothing is.
        """
        self._tests += 1
        self._by_chance.clear()
        drawn = self.draw("self-test", self._tests)
        physics, _ = timeline(drawn.physics, self._all_faults, self._trials)
        shape = CUBE if self._arena is None else self._arena.driver.shape
        placed = by_hand(in_the_middle(shape), drawn.rng)
        arena, _ = self._enter(shape, physics, drawn.noise_seed, placed, stop_reason)
        try:
            self._test(arena, drawn.rng, [])
        except OutOfServiceError:
            return self.wrong
        return None

    def forget(self) -> None:
        """Something went wrong that nobody understands: begin anew, with the object placed and the motors as warm as before."""
        if self._arena is not None:
            self._rise_k = self._arena.driver.motor_temperature_rise_k[0]
        self._arena = None

    @property
    def temperature_rise_k(self) -> float:
        """Of the hottest motor above ambient; may be asked for by another thread at any time."""
        arena = self._arena
        return float((self._rise_k if arena is None else arena.driver.motor_temperature_rise_k[0]).max())

    @property
    def _all_faults(self) -> tuple[Fault, ...]:
        return (*self.faults, *self._by_chance)

    def _let_chance_act(self, rng: np.random.Generator) -> None:
        if self.fault_rate and rng.random() < self.fault_rate:
            self._by_chance.append(draw_fault(rng, self.robot, self._trials))

    def _enter(
        self, shape: Shape, physics: Physics, noise_seed: int, placed: Start, stop_reason: StopReason
    ) -> tuple[Arena, str | None]:
        """The arena as the last trial left it, all at rest; a new one, with the object placed, for another object.

        Returns:
            The arena, and which encoder jumped since the last trial, as a sentence.
        """
        rise_k = self._rise_k if self._arena is None else self._arena.driver.motor_temperature_rise_k[0]
        if self._arena is None or self._arena.driver.shape != shape:
            self._arena = Arena.new(shape, physics, placed, self.sight)
        return self._arena, self._arena.wake(physics, noise_seed, rise_k, stop_reason)

    def _cool(self, arena: Arena, physics: Physics, events: list[str]) -> None:
        rise_k = arena.driver.motor_temperature_rise_k[0]
        wait_s = pause_s(rise_k, physics)
        if wait_s:
            events.append(f"the robot waited {wait_s:.0f} s for its motors to cool")
        arena.set_temperature(cooled_k(rise_k, physics, BETWEEN_TRIALS_S + wait_s))

    def _trust(self, error_rad: np.ndarray | None, what: str, arena: Arena, rng: np.random.Generator, events: list[str]) -> None:
        """Test the robot at once if a motion, after which its joints were off by so much, looks wrong."""
        if error_rad is not None and wrong_joint(error_rad) is not None:
            events.append(f"{what} looked wrong ({wrong_joint(error_rad)}), so that the robot tested itself")
            self._test(arena, rng, events)

    def _close(self, arena: Arena, jump: str | None, physics: Physics, rng: np.random.Generator, *, failed: bool) -> str | None:
        """The end of a trial: fingers back to their start pose. If anything looks wrong then, the robot tests itself."""
        seen = len(arena.motion.reports)
        try:
            if failed:
                arena.change(physics)
            if jump is not None:
                self._fail(jump)
            error_rad = retreat(arena.motion)
            arena.is_settled = True
            if failed or wrong_joint(error_rad) is not None or blind_camera(arena.motion.reports[seen:]) is not None:
                self._test(arena, rng, [])
        except OutOfServiceError as error:
            return str(error)
        except PhysicsDivergedError:
            self.forget()  # the trial has said so
        return None

    def _fail(self, wrong: str) -> NoReturn:
        self.wrong, self._since_test = wrong, None
        raise OutOfServiceError(f"{self.robot} is out of service: {wrong}")

    def _test(self, arena: Arena, rng: np.random.Generator, events: list[str]) -> None:
        """The self-test. Until it is passed there was none, should it be stopped.

        Raises:
            OutOfServiceError: it failed.
        """
        self._since_test, arena.is_settled = None, False
        self.wrong = _found_wrong(arena, rng)
        self.tests_ended += 1
        if self.wrong is not None:
            self._fail(self.wrong)
        self._since_test, arena.is_settled = 0, True
        events.append("the robot passed its self-test")


def physics_at(physics: Physics, changes: Sequence[Change], step: int) -> Physics:
    """The robot's physics a little after a step of its trial: so long that a controller that restarts is back."""
    come = [change.physics for change in changes if change.at_s <= step * c.PHYSICS_STEP_S + RESTART_S]
    return come[-1] if come else physics


def _found_wrong(arena: Arena, rng: np.random.Generator) -> str | None:
    """What is wrong with the robot, None if nothing is.

    It counts only if it is so with the object in the middle, too: an object may jam joints that are in order, and the cameras see
    the middle best.
    """
    shape = arena.driver.shape
    middle = by_hand(in_the_middle(shape), rng)
    if try_joints(arena.motion) is not None:
        arena.place(middle)
        arena.is_settled = False
        wrong = try_joints(arena.motion)
        if wrong is not None:
            return wrong
    if try_sight(arena.motion, shape) is None:
        return None
    arena.place(middle)
    return try_sight(arena.motion, shape, LOOK_AGAIN_S)


def in_the_middle(shape: Shape) -> Start:
    """The fingers in their start pose and the object, the right way up, in the middle of the arena."""
    start = draw_start(np.random.default_rng(0))
    position_m, quat_wxyz = np.array([[0.0, 0.0, shape.rest_height_m]]), np.array([[1.0, 0.0, 0.0, 0.0]])
    return replace(start, joint_position_rad=START_RAD[None].copy(), cube_position_world_m=position_m, cube_quat_wxyz=quat_wxyz)
