"""PPO of stable-baselines3 where the robots are elsewhere: its rollouts come from slices (``slices.py``)."""

import time
from typing import Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from sim_backend.environments.observation_space import gym_action_space
from sim_backend.environments.practice import Practice
from sim_backend.environments.vec_env import seen_space
from sim_backend.training.slices import Slices


class SlicedPPO(PPO):
    """PPO that has its rollouts from slices."""

    def __init__(self, slices: Slices, *arguments: Any, **keywords: Any) -> None:
        self._slices = slices
        super().__init__(*arguments, **keywords)
        self._last_obs = np.zeros(0)  # else stable-baselines3 resets the running returns, which a checkpoint may have brought

    def collect_rollouts(self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int) -> bool:
        """An iteration of all slices."""
        self._slices.watch = callback  # type: ignore[assignment]
        callback.on_rollout_start()
        if not callback.on_step():
            return False
        self._slices.collect(rollout_buffer)
        self.num_timesteps += env.num_envs * n_rollout_steps
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """The updates; minibatches are drawn by a seed of the iteration, so that they are the same after a checkpoint."""
        begun_s = time.perf_counter()
        run = self._slices.run
        self._slices.ahead()
        np.random.seed(np.random.SeedSequence([run.recipe.seed, run.iterations]).generate_state(4))
        super().train()
        self._slices.updated(time.perf_counter() - begun_s)


class SlicedRobots(VecEnv):
    """What PPO asks of its environment where the robots are elsewhere: spaces and numbers."""

    ended = None

    def __init__(self, practice: Practice, robots: int, *, privileged: bool) -> None:
        self.environment = _Practised(practice)
        super().__init__(robots, seen_space(practice, privileged), gym_action_space(practice.action_space))

    def reset(self):  # pyrefly: ignore[bad-override]
        """Nothing that anybody looks at."""
        return

    def step_async(self, actions: np.ndarray) -> None:
        """Slices step their own robots."""
        raise NotImplementedError("the robots are with the workers")

    def step_wait(self):
        """Likewise."""
        raise NotImplementedError("the robots are with the workers")

    def close(self) -> None:
        """Nothing is kept open."""

    def get_attr(self, attr_name: str, indices=None) -> list[Any]:  # noqa: ARG002 - asked for by the base class
        """No attribute is asked for but how it is rendered: not at all."""
        return [None] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices=None) -> None:
        """Nothing can be set."""

    def env_method(self, method_name: str, *method_args, indices=None, **method_kwargs) -> list[Any]:
        """No method can be called."""
        raise NotImplementedError("the robots are with the workers")

    def env_is_wrapped(self, wrapper_class, indices=None) -> list[bool]:  # noqa: ARG002 - asked for by the base class
        """No robot has a wrapper of its own."""
        return [False] * self.num_envs


class _Practised:
    def __init__(self, practice: Practice) -> None:
        self.practice = practice
