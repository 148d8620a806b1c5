"""Rewards as PPO gets them: scaled by the spread of returns, with the value of what would have come after a trial's end.

And advantages of rollouts that an older policy made, for which stable-baselines3 has nothing.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from sim_backend.environments.environment import Ended
from sim_backend.environments.vec_env import PRIVILEGED, SEEN

CLIP = 10.0


class NormalisedReturns(VecEnvWrapper):
    """Divides rewards by the standard deviation of discounted returns, and goes on counting where only time ended a trial.

    stable-baselines3 has both (``VecNormalize`` and a bootstrap in ``collect_rollouts``), but asks the critic once for each
    trial that ends; here it is asked once for all, unless there is no ``value_of``: a critic with memory is asked by sb3-contrib.
    Owner of the running return and its variance.

    Args:
        robots: the environment.
        discount: of PPO.
    """

    def __init__(self, robots: VecEnv, discount: float) -> None:
        super().__init__(robots)
        self._robots: Any = robots
        self._discount = discount
        self.running = np.zeros(robots.num_envs)
        self.mean, self.variance, self.count = 0.0, 1.0, 1e-4
        self.value_of: Callable | None = None

    @property
    def deviation(self) -> float:
        """What rewards are divided by."""
        return float(np.sqrt(self.variance + 1e-8))

    def reset(self):
        """Begin with all robots."""
        self.running[:] = 0.0
        return self.venv.reset()

    def step_wait(self):
        """One control period; where the reward has it already, ``info`` no longer says that time ended a trial."""
        observation, reward, done, infos = self.venv.step_wait()
        reward = self.scaled(reward, done)
        ended: Ended | None = self._robots.ended
        if ended is not None:
            goes_on = ~ended.diverged
            if self.value_of is not None and goes_on.any():
                last = ended.observation[goes_on]
                seen = {SEEN: last, PRIVILEGED: ended.privileged[goes_on]} if isinstance(observation, dict) else last
                reward[ended.robots[goes_on]] += self._discount * self.value_of(seen)
            for robot in () if self.value_of is None else ended.robots:
                infos[robot]["TimeLimit.truncated"] = False
        return observation, reward, done, infos

    def scaled(self, reward: np.ndarray, done: np.ndarray) -> np.ndarray:
        """The rewards of all robots in a control period as PPO gets them, once they have gone into the spread; shapes (n,)."""
        self.running = self.running * self._discount + reward
        self._learn(self.running)
        self.running[done] = 0.0
        return np.clip(reward / self.deviation, -CLIP, CLIP)

    def _learn(self, values: np.ndarray) -> None:
        n, mean, variance = len(values), float(values.mean()), float(values.var())
        total, apart = self.count + n, mean - self.mean
        squares = self.variance * self.count + variance * n + apart**2 * self.count * n / total
        self.mean, self.variance, self.count = self.mean + apart * n / total, squares / total, total


def advantages_by_importance(
    rewards: np.ndarray,
    values: np.ndarray,
    last_values: np.ndarray,
    dones: np.ndarray,
    weights: np.ndarray,
    discount: float,
    gae_lambda: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Advantages and the critic's targets where another policy acted: V-trace with a lambda, GAE where all weights are 1.

    Source: L. Espeholt et al., "IMPALA: Scalable Distributed Deep-RL with Importance Weighted Actor-Learner Architectures",
    ICML 2018, section 4.1, with both of its limits at 1.

    Args:
        rewards: of each step and robot, shape (steps, robots).
        values: the present critic's of what was seen in each step, same shape.
        last_values: of what is seen after the last step, shape (robots,).
        dones: where a trial ended with a step, shape (steps, robots).
        weights: how much likelier the present policy is to act as was acted, already limited to at most 1; same shape.
        discount: of PPO.
        gae_lambda: of PPO.

    Returns:
        advantages, with the step's own weight in them, and targets; both of shape (steps, robots).
    """
    goes_on = 1.0 - dones.astype(np.float32)
    following = np.concatenate([values[1:], last_values[None]])
    differences = rewards + discount * goes_on * following - values
    advantages = np.empty_like(differences)
    weighted = np.zeros_like(last_values)  # of the step after
    for step in reversed(range(len(rewards))):
        advantages[step] = weighted = weights[step] * (differences[step] + discount * gae_lambda * goes_on[step] * weighted)
    return advantages, values + advantages
