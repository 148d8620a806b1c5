"""A few steps of training in trifarm's own environment by stable-baselines3, rsl_rl and skrl, as their users write it."""

import gymnasium
import numpy as np
import torch

import trifarm

ROBOTS = 2


def robots():
    """Robots that practise ``push``."""
    return trifarm.TrifingerVecEnv(trifarm.practice_of("push", episode_s=0.2), robots=ROBOTS, threads=1)


def stable_baselines3():
    """A model, its environment, and a function from observations (k, n) to actions in ±1."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    env = VecNormalize(robots())
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=8, n_epochs=1, seed=0, device="cpu").learn(16)

    def act(rows):
        return np.clip(model.predict(env.normalize_obs(rows), deterministic=True)[0], -1, 1)

    return model, env, act


class ForRslRl:
    """``rsl_rl.env.VecEnv`` around a ``VecEnv`` of stable-baselines3."""

    def __init__(self, env):
        self.env, self.num_envs, self.num_actions = env, env.num_envs, 9
        self.max_episode_length, self.device, self.cfg = 10, "cpu", {}
        self.episode_length_buf = torch.zeros(self.num_envs, dtype=torch.long)
        self._seen = env.reset()

    def get_observations(self):
        from tensordict import TensorDict

        return TensorDict({"policy": torch.from_numpy(self._seen)}, batch_size=[self.num_envs])

    def step(self, actions):
        self._seen, reward, done, _ = self.env.step(actions.numpy())
        return self.get_observations(), torch.from_numpy(reward), torch.from_numpy(done).long(), {}


def rsl_rl():
    """The same with rsl_rl."""
    from rsl_rl.runners import OnPolicyRunner
    from tensordict import TensorDict

    model = {"class_name": "MLPModel", "hidden_dims": [16], "activation": "tanh", "obs_normalization": True}
    settings = {
        "seed": 1,
        "num_steps_per_env": 8,
        "save_interval": 100,
        "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
        "actor": model | {"distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 1.0}},
        "critic": dict(model),
        "algorithm": {"class_name": "PPO", "num_learning_epochs": 1, "num_mini_batches": 1, "learning_rate": 1e-2},
    }
    env = ForRslRl(robots())
    runner = OnPolicyRunner(env, settings, log_dir=None, device="cpu")
    runner.learn(1)
    policy = runner.get_inference_policy()

    def act(rows):
        with torch.no_grad():
            given = TensorDict({"policy": torch.from_numpy(rows)}, batch_size=[len(rows)])
            return policy(given).clamp(-1, 1).numpy()

    return runner, env, act


def skrl():
    """The same with skrl, in the Gymnasium environment."""
    from skrl.agents.torch.ppo import PPO, PPO_CFG
    from skrl.envs.wrappers.torch import wrap_env
    from skrl.memories.torch import RandomMemory
    from skrl.resources.preprocessors.torch import RunningStandardScaler
    from skrl.trainers.torch import SequentialTrainer
    from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model

    env = wrap_env(gymnasium.wrappers.PassiveEnvChecker(trifarm.TrifingerEnv("push")), wrapper="gymnasium", verbose=False)
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": env.device}
    network = [{"name": "net", "input": "OBSERVATIONS", "layers": [16, 16], "activations": "relu"}]
    models = {
        "policy": gaussian_model(**spaces, network=network, output="ACTIONS"),
        "value": deterministic_model(**spaces, network=network, output="ONE"),
    }
    scaling = {"size": env.observation_space, "device": env.device}
    settings = PPO_CFG(
        rollouts=8,
        learning_epochs=1,
        mini_batches=1,
        observation_preprocessor=RunningStandardScaler,
        observation_preprocessor_kwargs=scaling,
    )
    settings.experiment.write_interval = settings.experiment.checkpoint_interval = 0
    agent = PPO(models=models, memory=RandomMemory(memory_size=8, num_envs=1, device=env.device), cfg=settings, **spaces)
    quiet = {"timesteps": 8, "headless": True, "disable_progressbar": True, "close_environment_at_exit": False}
    SequentialTrainer(env=env, agents=agent, cfg=quiet).train()

    def act(rows):
        with torch.no_grad():
            seen = agent._observation_preprocessor(torch.from_numpy(rows))
            found = models["policy"].act({"observations": seen}, role="policy")[1]["mean_actions"]
        return found.clamp(-1, 1).numpy()

    return agent, env, act


LIBRARIES = {"stable_baselines3": stable_baselines3, "rsl_rl": rsl_rl, "skrl": skrl}
