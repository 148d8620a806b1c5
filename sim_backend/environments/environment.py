"""Many robots that practise a task, each beginning a new trial when its last one is over; one of them is a Gymnasium environment.

A step is the control period of the farm's trials (``episode.py``) with the same effects, tracker and starts; what is added here
is what training needs: actions in [-1, 1], rewards, and new trials on newly drawn robots.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim_backend.driver.physics_backend import PhysicsBackend
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import Tracker
from sim_backend.effects.physics import Physics
from sim_backend.environments.practice import Practice
from sim_backend.episode import Episode
from sim_backend.observation import Sight
from sim_backend.tasks.reward import State, fingers_away_m, reward_of
from sim_backend.tasks.scoring import Scores, score
from sim_backend.tasks.task import Goal, draw_trial, stack_goals, stack_starts
from sim_backend.trifinger.kinematics import fingertip_position_world_m
from sim_backend.trifinger.objects import CUBE, resting_height_m

GREATEST_OBSERVATION = 1e6
"""What a simulation that became unstable shows is clipped to this."""
COHORTS = 25
"""The first trials of many robots end at so many different times, so that later ones are at all stages at once."""


@dataclass(frozen=True)
class Ended:
    """Trials that ended in a step: which robots', what was seen and known last (k, ...), and how well the goals were reached.

    ``diverged`` (k,) marks those that ended because the physics became unstable.
    """

    robots: np.ndarray
    observation: np.ndarray
    privileged: np.ndarray
    scores: Scores
    diverged: np.ndarray


@dataclass(frozen=True)
class Stepped:
    """One control period of n robots: the observation that the next action follows (n, size) float32, and the reward (n,)."""

    observation: np.ndarray
    reward: np.ndarray
    ended: Ended | None


class Environment:
    """n simulated robots under one manifest. Owner of their goals, of the lengths of their trials and of what is drawn.

    Args:
        practice: what is practised.
        robots: n.
        threads: of the physics.
        begins_anew: whether robots whose trials end begin new ones; otherwise :meth:`reset` must be called.
        physics_backend: where the physics runs.
    """

    def __init__(
        self,
        practice: Practice,
        *,
        robots: int = 1,
        threads: int = 1,
        begins_anew: bool = True,
        physics_backend: PhysicsBackend = PhysicsBackend.CPU,
    ) -> None:
        self.practice, self.robots, self._begins_anew = practice, robots, begins_anew
        step_s = practice.physics_step_s
        self._driver = SimulatedDriver(
            robots=robots, threads=threads, physics_step_s=step_s, divergence_ends=False, backend=physics_backend
        )
        self._tracker = Tracker(physics_step_s=step_s)
        self._episode = Episode(self._driver, self._tracker, practice.manifest, physics_step_s=step_s)
        self._period_steps = round(1 / practice.manifest.rate_hz / step_s)

    def reset(self, rng: np.random.Generator, *, trial_seed: int | None = None) -> np.ndarray:
        """Begin with all robots; returns what they see, shape (n, size), float32.

        Args:
            rng: draws robots, starts, goals and noise from now on.
            trial_seed: draws start, goal and noise of a single robot's first trial as on the farm, instead.
        """
        self._rng = rng
        seeds = self._draw_seeds(self.robots) if trial_seed is None else np.array([trial_seed])
        physics = self._draw_physics(np.arange(self.robots))
        self._driver.set_physics(physics)
        self._tracker.set_physics(physics)
        self._episode.begin(*self._draw_trials(seeds, physics))
        self._ends_at = np.full(self.robots, self.practice.periods * self._period_steps)
        if self.robots >= COHORTS:
            share = 1 + np.arange(self.robots) * COHORTS // self.robots
            self._ends_at = share * self.practice.periods // COHORTS * self._period_steps
        self._look()
        return self._observe()

    def state(self) -> dict[str, Any]:
        """What :meth:`restore` needs to go on from here with the same bits: numbers and arrays, some 5 kB a robot."""
        parts = {"driver": self._driver.state(), "tracker": self._tracker.state(), "episode": self._episode.state()}
        return {**parts, "ends_at": self._ends_at.copy()}

    def restore(self, state: Mapping[str, Any]) -> np.ndarray:
        """Go on from what :meth:`state` of an environment of the same practice and as many robots gave.

        Call :meth:`draw_by` before the next step. Returns what the robots see, shape (n, size), float32.
        """
        self._driver.restore(state["driver"])
        self._tracker.set_physics(self._driver.physics)
        self._tracker.restore(state["tracker"])
        seen = self._episode.restore(state["episode"])
        self._ends_at = state["ends_at"].copy()
        self._look()
        return _finite(seen)

    def draw_by(self, rng: np.random.Generator) -> None:
        """Draw robots, starts, goals and noise by this generator from now on."""
        self._rng = rng

    def step(self, action: np.ndarray) -> Stepped:
        """Advance by one control period; robots whose trials end begin new ones.

        Args:
            action: shape (n, 9), as the action space has it.
        """
        torque_or_position = self.practice.action_space.to_command(action)
        self._episode.advance(torque_or_position)
        was_away_m = self._away_m
        self._look()
        approached_m = was_away_m - self._away_m
        goal, state = self._episode.goal, self._state
        reward = reward_of(
            self.practice.reward, self.practice.task, goal, state, approached_m, 1 / self.practice.manifest.rate_hz
        )
        diverged = self._driver.diverged
        over = np.flatnonzero(diverged | (self._episode.trial_step >= self._ends_at))
        ended = None
        if len(over):
            if diverged.any():
                reward = np.where(diverged, 0.0, reward)
            ended = Ended(over, self._observe()[over], self.privileged()[over], self._scores(over), diverged[over])
            if self._begins_anew:
                self._begin_anew(over)
        return Stepped(self._observe(), reward, ended)

    def privileged(self) -> np.ndarray:
        """What only a simulation knows, for a critic, shape (n, ``privileged_size``), float32; see ``PRIVILEGED``."""
        measurement, physics = self._episode.measurement, self._driver.physics
        parts = [
            measurement.true_joint_position_rad,
            measurement.true_joint_velocity_rad_s,
            measurement.cube_position_world_m,
            measurement.cube_quat_wxyz * np.where(measurement.cube_quat_wxyz[:, :1] < 0, -1.0, 1.0),
            self._driver.cube_velocity,
            self._state.fingertip_position_world_m,
            *(physics.value(key).reshape(self.robots, -1).mean(axis=1, keepdims=True) for key in PRIVILEGED_EFFECTS),
        ]
        return _finite(np.concatenate(parts, axis=1))

    @property
    def physics(self) -> Physics:
        """The robots' effects."""
        return self._driver.physics

    @property
    def goal(self) -> Goal:
        """The robots' goals."""
        return self._episode.goal

    def sight(self) -> Sight:
        """What observations may be made of now, for those who see something else than the robots' own policies."""
        return self._episode.sight()

    def scores(self) -> Scores:
        """How well the goals are reached now, shapes (n,)."""
        return self._scores(np.arange(self.robots))

    def _begin_anew(self, robots: np.ndarray) -> None:
        physics = self._draw_physics(robots)
        if not (physics.is_nominal and self._driver.physics.is_nominal):
            self._driver.set_physics(physics, robots)
            self._tracker.set_physics(self._driver.physics)
        self._episode.restart(robots, *self._draw_trials(self._draw_seeds(len(robots)), physics))
        self._ends_at[robots] = self.practice.periods * self._period_steps
        self._look()

    def _look(self) -> None:
        measurement = self._episode.measurement
        self._state = State(
            measurement.cube_position_world_m,
            measurement.cube_quat_wxyz,
            fingertip_position_world_m(measurement.true_joint_position_rad),
            measurement.true_joint_velocity_rad_s,
        )
        self._away_m = fingers_away_m(self.practice.task, self._episode.goal, self._state)

    def _observe(self) -> np.ndarray:
        return _finite(self._episode.observe())

    def _scores(self, robots: np.ndarray) -> Scores:
        measurement = self._episode.measurement
        return score(
            self.practice.task,
            self._episode.goal.rows(robots),
            measurement.cube_position_world_m[robots],
            measurement.cube_quat_wxyz[robots],
            measurement.true_joint_position_rad[robots],
        )

    def _draw_physics(self, robots: np.ndarray) -> Physics:
        draw = self.practice.draw_physics
        return Physics.nominal(len(robots)) if draw is None else draw(self._rng, robots)

    def _draw_seeds(self, n: int) -> np.ndarray:
        return self._rng.integers(2**53, size=n)

    def _draw_trials(self, seeds: np.ndarray, physics: Physics):
        """Starts and goals as on the farm, each from its seed, the cube at rest on the table; the seed also draws the noise."""
        drawn = [draw_trial(self.practice.task, int(seed)) for seed in seeds]
        start, goal = stack_starts([start for start, _ in drawn]), stack_goals([goal for _, goal in drawn])
        position = start.cube_position_world_m.copy()
        position[:, 2] = resting_height_m(CUBE, start.cube_quat_wxyz) * physics.value("cube_size.factor")
        return replace(start, cube_position_world_m=position, noise_seed=seeds.astype(float)), goal


PRIVILEGED_EFFECTS = (
    "fingertip_friction.coefficient",
    "table_friction.coefficient",
    "cube_mass.factor",
    "cube_size.factor",
    "action_delay.delay_s",
    "torque_constant.error",
    "coulomb_friction.torque_nm",
    "tracking_latency.extra_s",
)
PRIVILEGED: dict[str, int] = {
    "true joint position, rad": 9,
    "true joint velocity, rad/s": 9,
    "true cube position, m": 3,
    "true cube orientation, wxyz with w >= 0": 4,
    "cube velocity, m/s and rad/s": 6,
    "true fingertip position, m": 9,
} | {f"{key}, mean over joints": 1 for key in PRIVILEGED_EFFECTS}
PRIVILEGED_SIZE = sum(PRIVILEGED.values())


def _finite(values: np.ndarray) -> np.ndarray:
    """As float32, without what an unstable simulation leaves behind."""
    shown = values.astype(np.float32)
    if not np.isfinite(shown.sum()):
        shown = np.nan_to_num(shown, nan=0.0, posinf=GREATEST_OBSERVATION, neginf=-GREATEST_OBSERVATION)
        np.clip(shown, -GREATEST_OBSERVATION, GREATEST_OBSERVATION, out=shown)
    return shown
