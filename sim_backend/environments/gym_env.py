"""One simulated TriFinger as a Gymnasium environment: ``gymnasium.make("trifarm/Push-v0")``.

Gymnasium finds environments that a module registers when it is imported, which is why this one does so; without an import of
``sim_backend.environments.gym_env``, ``gymnasium.make("sim_backend.environments.gym_env:trifarm/Push-v0")`` finds it, too.
"""

from typing import Any

import gymnasium
import numpy as np

from api_schemas.policy import PolicyManifest
from sim_backend.environments.action_space import ActionSpace
from sim_backend.environments.environment import Environment
from sim_backend.environments.observation_space import gym_action_space, observation_space
from sim_backend.environments.practice import DrawPhysics, practice_of
from sim_backend.tasks import TASKS
from sim_backend.tasks.reward import Reward
from sim_backend.trifinger import constants as c

IDS: dict[str, str] = {f"trifarm/{''.join(word.capitalize() for word in name.split('_'))}-v0": name for name in TASKS}
"""Registered environments and the farm's tasks that they practise."""


class TrifingerEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """One robot, one trial after the other; a step is a control period of the farm's trials (20 ms).

    Action space, ``Box(-1, 1, (9,), float32)``; joints 0 to 2 are those of finger0 from base to tip, then finger120, finger240:

    | index | meaning | min | max | unit |
    |---|---|---|---|---|
    | 0 to 8 with ``action="torque"`` | torque at the joint, in 0.396 N m | -1 | 1 | |
    | 0 to 8 with ``action="joint position"`` | position between the ends of the joint's range | -1 | 1 | |
    | 0 to 8 with ``action="joint delta"`` | change of the measured position, in 0.1 rad | -1 | 1 | |
    | 0 to 8 with ``action="dactyl bins"`` (``MultiDiscrete``) | the same change, as the number of one of 11 bins | 0 | 10 | |

    Observation space with the layout ``keypoints``, which all tasks but reach have by default, ``Box(75,)``, float32:

    | index | meaning | min | max | unit |
    |---|---|---|---|---|
    | 0 to 8 | joint_position_rad: measured positions, finger0 to finger240, base to tip | -6.28 | 6.28 | rad |
    | 9 to 17 | joint_velocity_rad_s: measured velocities | -100 | 100 | rad/s |
    | 18 to 41 | cube_keypoints_world_m: corners of the cube by the newest report, x y z each | -2 | 2 | m |
    | 42 to 65 | goal_keypoints_world_m: wanted corners of the cube, x y z each | -1 | 1 | m |
    | 66 to 74 | previous_action: what was asked in the step before, as the manifest has it | -2 | 2 | N m or rad |

    with the layout ``reach``, the default of reach, ``Box(45,)``:

    | index | meaning | min | max | unit |
    |---|---|---|---|---|
    | 0 to 8 | joint_position_rad: measured positions, finger0 to finger240, base to tip | -6.28 | 6.28 | rad |
    | 9 to 17 | joint_velocity_rad_s: measured velocities | -100 | 100 | rad/s |
    | 18 to 26 | fingertip_position_world_m: tips by the measured positions, x y z each | -1 | 1 | m |
    | 27 to 35 | goal_fingertip_position_world_m: wanted tips, x y z each | -1 | 1 | m |
    | 36 to 44 | previous_action: what was asked in the step before, as the manifest has it | -2 | 2 | N m or rad |

    with the layout ``pose``, ``Box(41,)``:

    | index | meaning | min | max | unit |
    |---|---|---|---|---|
    | 0 to 8 | joint_position_rad: measured positions, finger0 to finger240, base to tip | -6.28 | 6.28 | rad |
    | 9 to 17 | joint_velocity_rad_s: measured velocities | -100 | 100 | rad/s |
    | 18 to 20 | cube_position_world_m: newest report of the tracker | -2 | 2 | m |
    | 21 to 24 | cube_quat_wxyz: newest report of the tracker | -1 | 1 | |
    | 25 to 27 | goal_position_world_m: wanted place of the cube | -1 | 1 | m |
    | 28 to 31 | goal_quat_wxyz: wanted orientation of the cube | -1 | 1 | |
    | 32 to 40 | previous_action: what was asked in the step before, as the manifest has it | -2 | 2 | N m or rad |

    ``layouts.py`` has the others, among them those of the published policies (``rrc2022-push``, ``rrc2022-lift``).

    A trial is truncated after the task's time and terminated only where the physics became unstable. ``info`` has ``success``,
    ``position_error_m`` and ``angle_error_rad`` of the present state. ``reset(options={"trial_seed": 7})`` begins the farm's
    trial with that seed.

    Args:
        task: one of the farm's tasks.
        layout: what is seen, by name, or a manifest of one's own.
        action: what an action means.
        reward: how nearness to the goal is rewarded, or all weights.
        physics: name of a preset or path of a file whose robots are practised with, a new one for each trial, or a function
            that draws them.
        episode_s: length of a trial; the task's own if None.
        physics_step_s: integration step; the farm's has 1 ms.

    Example:
        >>> import trifarm
        >>> env = trifarm.TrifingerEnv("push", physics="real")
        >>> observation, info = env.reset(seed=1)
        >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        >>> observation.shape
        (75,)
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - Gymnasium's own name and kind

    def __init__(
        self,
        task: str = "push",
        *,
        layout: str | PolicyManifest | None = None,
        action: str | ActionSpace = "torque",
        reward: str | Reward = "keypoint kernel",
        physics: str | DrawPhysics = "nominal",
        episode_s: float | None = None,
        physics_step_s: float = c.PHYSICS_STEP_S,
    ) -> None:
        practice = practice_of(
            task,
            layout=layout,
            action=action,
            reward=reward,
            physics=physics,
            episode_s=episode_s,
            physics_step_s=physics_step_s,
        )
        self._environment = Environment(practice, begins_anew=False)
        self.observation_space = observation_space(practice.manifest)
        self.action_space = gym_action_space(practice.action_space)

    @property
    def manifest(self) -> PolicyManifest:
        """What a policy that is trained here is submitted with."""
        return self._environment.practice.manifest

    @property
    def environment(self) -> Environment:
        """The robot and its task."""
        return self._environment

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a new trial; see Gymnasium."""
        super().reset(seed=seed)
        observation = self._environment.reset(self.np_random, trial_seed=(options or {}).get("trial_seed"))
        return self._shown(observation[0]), self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by one control period; see Gymnasium."""
        stepped = self._environment.step(np.asarray(action)[None])
        diverged = stepped.ended is not None and bool(stepped.ended.diverged[0])
        truncated = stepped.ended is not None and not diverged
        return self._shown(stepped.observation[0]), float(stepped.reward[0]), diverged, truncated, self._info()

    def _shown(self, observation: np.ndarray) -> np.ndarray:
        space = self.observation_space
        assert isinstance(space, gymnasium.spaces.Box)
        return np.clip(observation, space.low, space.high)

    def _info(self) -> dict[str, Any]:
        scores = self._environment.scores()
        return {
            "success": bool(scores.success[0]),
            "position_error_m": float(scores.position_error_m[0]),
            "angle_error_rad": float(scores.angle_error_rad[0]),
        }


for _id, _task in IDS.items():
    gymnasium.register(_id, entry_point="sim_backend.environments.gym_env:TrifingerEnv", kwargs={"task": _task})
