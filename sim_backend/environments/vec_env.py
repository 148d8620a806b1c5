"""Many simulated TriFingers at once as a ``VecEnv`` of stable-baselines3; all of them advance in one call of the physics."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from api_schemas.policy import PolicyManifest
from sim_backend.driver.physics_backend import PhysicsBackend
from sim_backend.environments.environment import PRIVILEGED_SIZE, Ended, Environment
from sim_backend.environments.observation_space import gym_action_space, observation_space
from sim_backend.environments.practice import Practice

SEEN, PRIVILEGED = "seen", "privileged"
"""Parts of the observation where a critic may know more than the policy."""
GREATEST_PRIVILEGED = 1e6


class TrifingerVecEnv(VecEnv):
    """n robots; nothing but what a trial's end asks for goes through them one by one.

    With ``privileged`` observations are ``{"seen": what the policy sees, "privileged": what only a simulation knows}``
    (``environment.PRIVILEGED``), for a critic. The ``info`` of a robot whose trial ended has ``episode`` (``r`` return, ``l``
    steps), ``is_success``, ``TimeLimit.truncated`` and ``terminal_observation``; all others are one and the same empty table.

    Args:
        practice: what is practised.
        robots: n.
        threads: of the physics.
        seed: draws robots, starts, goals and noise.
        privileged: whether observations have the privileged part.
        physics_backend: where the physics runs.

    Example:
        >>> import numpy as np, trifarm
        >>> robots = trifarm.TrifingerVecEnv(trifarm.practice_of("push"), robots=8)
        >>> robots.reset().shape
        (8, 75)
        >>> observations, rewards, dones, infos = robots.step(np.zeros((8, 9), np.float32))
    """

    def __init__(
        self,
        practice: Practice,
        *,
        robots: int,
        threads: int = 2,
        seed: int = 0,
        privileged: bool = False,
        physics_backend: PhysicsBackend = PhysicsBackend.CPU,
    ) -> None:
        self.environment = Environment(practice, robots=robots, threads=threads, physics_backend=physics_backend)
        self._privileged = privileged
        self._rng = np.random.default_rng(seed)
        super().__init__(robots, seen_space(practice, privileged), gym_action_space(practice.action_space))
        self._nothing: list[dict[str, Any]] = [{}] * robots
        self.ended: Ended | None = None

    @property
    def manifest(self) -> PolicyManifest:
        """What a policy that is trained here is submitted with."""
        return self.environment.practice.manifest

    def reset(self):
        """Begin with all robots."""
        if self._seeds[0] is not None:
            self._rng = np.random.default_rng(self._seeds[0])
        self._reset_seeds()
        self._return, self._length = np.zeros(self.num_envs), np.zeros(self.num_envs, dtype=np.int64)
        return self._shown(self.environment.reset(self._rng))

    def step_async(self, actions: np.ndarray) -> None:
        """Keep what the robots are to do."""
        self._actions = actions

    def step_wait(self):
        """Advance all robots by one control period."""
        stepped = self.environment.step(self._actions)
        self._return += stepped.reward
        self._length += 1
        self.ended, done, infos = stepped.ended, np.zeros(self.num_envs, dtype=bool), self._nothing
        if stepped.ended is not None:
            done[stepped.ended.robots] = True
            infos = self._infos(stepped.ended)
            self._return[done], self._length[done] = 0.0, 0
        return self._shown(stepped.observation), stepped.reward.astype(np.float32), done, infos

    def _infos(self, ended: Ended) -> list[dict[str, Any]]:
        infos = list(self._nothing)
        for i, robot in enumerate(ended.robots):
            seen = ended.observation[i]
            infos[robot] = {
                "episode": {"r": float(self._return[robot]), "l": int(self._length[robot])},
                "is_success": bool(ended.scores.success[i]),
                "TimeLimit.truncated": not ended.diverged[i],
                "terminal_observation": {SEEN: seen, PRIVILEGED: ended.privileged[i]} if self._privileged else seen,
            }
        return infos

    def _shown(self, observation: np.ndarray):
        return {SEEN: observation, PRIVILEGED: self.environment.privileged()} if self._privileged else observation

    def close(self) -> None:
        """Nothing is kept open."""

    def get_attr(self, attr_name: str, indices=None) -> list[Any]:
        """An attribute of the environment, the same for each robot asked for."""
        value = None if attr_name == "render_mode" else getattr(self, attr_name)
        return [value] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices=None) -> None:  # noqa: ARG002 - all have it in common
        """Set an attribute; the robots share it."""
        setattr(self, attr_name, value)

    def env_method(self, method_name: str, *method_args, indices=None, **method_kwargs) -> list[Any]:
        """Call a method once; its result stands for each robot asked for."""
        return [getattr(self, method_name)(*method_args, **method_kwargs)] * len(self._chosen(indices))

    def env_is_wrapped(self, wrapper_class, indices=None) -> list[bool]:  # noqa: ARG002 - asked for by the base class
        """No robot has a wrapper of its own."""
        return [False] * len(self._chosen(indices))

    def _chosen(self, indices) -> Sequence[int]:
        return list(self._get_indices(indices))


def seen_space(practice: Practice, privileged: bool) -> spaces.Space:
    """The space of observations, with the privileged part where there is one."""
    space: spaces.Space = observation_space(practice.manifest)
    if not privileged:
        return space
    bound = np.full(PRIVILEGED_SIZE, GREATEST_PRIVILEGED, dtype=np.float32)
    return spaces.Dict({SEEN: space, PRIVILEGED: spaces.Box(-bound, bound, dtype=np.float32)})
