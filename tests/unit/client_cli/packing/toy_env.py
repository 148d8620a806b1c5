"""An environment of random observations, for training a few steps."""

import gymnasium
import numpy as np


class ToyEnv(gymnasium.Env):
    """Rewards small actions; bounds of the actions are not ±1 where they are continuous."""

    def __init__(self, size, *, bins=False):
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        box = gymnasium.spaces.Box(-0.8, 0.8, (9,), np.float32)
        self.action_space = gymnasium.spaces.MultiDiscrete([11] * 9) if bins else box
        self._rng = np.random.default_rng(0)

    def _seen(self):
        return (self._rng.normal(size=self.observation_space.shape) * 3 + 1).astype(np.float32)

    def reset(self, *, seed=None, options=None):
        self._step = 0
        return self._seen(), {}

    def step(self, action):
        self._step += 1
        return self._seen(), -float(np.square(action).sum()), self._step >= 20, False, {}
