"""One control period after the other: observe, act, advance. The only place where physics moves.

A trial on the farm, a Gymnasium step and a vectorised training step are all this class with another number of robots.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from api_schemas.policy import ActionKind, PolicyManifest
from sim_backend.driver.driver import Command, Driver, Measurement, Segment, Start, hold_command
from sim_backend.driver.tracker import TrackedPose, Tracker
from sim_backend.observation import ObservationBuilder, Sight
from sim_backend.tasks.task import Goal
from sim_backend.trifinger import constants as c


class Period(NamedTuple):
    """What happened in one control period of n robots.

    ``observation`` (n, size) was read before ``action`` (n, 9) acted; ``tracked`` are the poses delivered within the period
    and ``after`` is the state at its end.
    """

    observation: np.ndarray
    action: np.ndarray
    segment: Segment
    tracked: list[TrackedPose]
    after: Measurement


class Episode:
    """n robots that try n goals under one manifest. Owner of the control clock.

    Between the observation and the manifest's delay after it the previous command goes on acting, as on the real robot;
    before the first action the robot holds its start position. Robots may begin anew while others go on (:meth:`restart`):
    each one's trial has a clock of its own.
    """

    def __init__(
        self, driver: Driver, tracker: Tracker, manifest: PolicyManifest, *, physics_step_s: float = c.PHYSICS_STEP_S
    ) -> None:
        self._driver, self._tracker, self._manifest = driver, tracker, manifest
        self._builder = ObservationBuilder(manifest.observation)
        self._period_steps = round(1 / manifest.rate_hz / physics_step_s)
        self._delay_steps = round(manifest.action_delay_s / physics_step_s)
        self._physics_step_s = physics_step_s

    def begin(self, start: Start, goal: Goal) -> TrackedPose:
        """Reset robots, tracker and clock; returns the pose that the tracker knows at the start."""
        self._driver.reset(start)
        self._goal = goal
        self._step, self._begun = 0, np.zeros(len(start.joint_position_rad), dtype=np.int64)
        self._measurement = self._measured()
        self._command = hold_command(self._measurement.joint_position_rad)
        self._previous_action = np.zeros((len(start.joint_position_rad), 9))
        return self._tracker.reset(self._measurement, start.noise_seed)

    def restart(self, robots: np.ndarray, start: Start, goal: Goal) -> None:
        """Begin new trials with some of the robots, one row of start and goal each, while the others go on."""
        self._driver.reset(start, robots)
        self._goal = self._goal.with_rows(robots, goal)
        self._begun[robots] = self._step
        self._measurement = self._measured()
        self._command = _held(self._command, robots, self._measurement.joint_position_rad[robots])
        self._previous_action = self._previous_action.copy()
        self._previous_action[robots] = 0.0
        self._tracker.restart(robots, self._measurement, start.noise_seed, self._step)

    def state(self) -> dict[str, Any]:
        """What :meth:`restore` needs, driver and tracker apart: numbers and arrays."""
        return {
            "step": self._step,
            "begun": self._begun.copy(),
            "goal": dict(vars(self._goal)),
            "measurement": {name: value for name, value in self._measurement._asdict().items() if value is not None},
            "command": {name: value for name, value in self._command._asdict().items() if value is not None},
            "previous_action": self._previous_action,
            "observation": self._observation,
        }

    def restore(self, state: Mapping[str, Any]) -> np.ndarray:
        """Go on from what :meth:`state` gave, driver and tracker being restored; returns the last observation."""
        self._step, self._begun = int(state["step"]), state["begun"].copy()
        self._goal, self._measurement = Goal(**state["goal"]), Measurement(**state["measurement"])
        self._command, self._previous_action = Command(**state["command"]), state["previous_action"]
        self._observation = state["observation"]
        return self._observation

    def change_goals(self, robots: np.ndarray, goal: Goal) -> None:
        """Give some of the robots other goals, one row each, while their trials go on."""
        self._goal = self._goal.with_rows(robots, goal)

    @property
    def step(self) -> int:
        """Physics steps since the start of all."""
        return self._step

    @property
    def trial_step(self) -> np.ndarray:
        """Physics steps since the begin of each robot's trial, shape (n,)."""
        return self._step - self._begun

    @property
    def goal(self) -> Goal:
        """The goals of all robots."""
        return self._goal

    def observe(self) -> np.ndarray:
        """The observation of all robots now, shape (n, size)."""
        self._observation = self._builder.build(self.sight())
        return self._observation

    def sight(self) -> Sight:
        """What observations of all robots may be made of now."""
        trial_step = self.trial_step
        return Sight(
            trial_step,
            self._measurement,
            self._tracker.reading(trial_step),
            self._goal,
            self._previous_action,
            self._physics_step_s,
        )

    def advance(self, action: np.ndarray) -> Period:
        """Apply the action of the last observation, shape (n, 9), and advance by one control period."""
        command = command_of(self._manifest.action_kind, action, self._measurement)
        schedule = [(self._command, self._delay_steps), (command, self._period_steps - self._delay_steps)]
        segment = self._driver.advance([(command, steps) for command, steps in schedule if steps])
        self._step += self._period_steps
        self._command, self._previous_action = command, action
        self._tracker.capture(segment)
        self._measurement = self._measured()
        return Period(self._observation, action, segment, self._tracker.deliver(self._step), self._measurement)

    def _measured(self) -> Measurement:
        """What is measured now, with the fingertips' forces where the manifest names them."""
        return self._driver.measure(feel=True) if self._builder.feels else self._driver.measure()

    @property
    def measurement(self) -> Measurement:
        """The present state of all robots."""
        return self._measurement


def _held(command: Command, robots: np.ndarray, joint_position_rad: np.ndarray) -> Command:
    """A command that lets some robots hold a position, one row each, and is as it was for the others."""
    torque_nm = command.desired_torque_nm.copy()
    target = np.full_like(torque_nm, np.nan) if command.position_target_rad is None else command.position_target_rad.copy()
    torque_nm[robots], target[robots] = 0.0, joint_position_rad
    return Command(torque_nm, target)


def command_of(kind: ActionKind, action: np.ndarray, measurement: Measurement) -> Command:
    """The command that an action of shape (n, 9) stands for."""
    if kind is ActionKind.TORQUE:
        return Command(action)
    if kind is ActionKind.JOINT_POSITION:
        return Command(np.zeros_like(action), action)
    return Command(np.zeros_like(action), measurement.joint_position_rad + action)
